//! Traces one pixel of a frame: the inputs of the fragment function, and each step of the function in the engine.

use super::tap::{Candidate, Read, TapError, candidates, read};
use super::{Frame, drawn};
use crate::draw::{DrawError, Drawing, Format, Source};
use crate::executor;
use crate::fixture::{self, Fixtures};
use crate::interpret::trace::{BRIEFLY, Pixel, Step, trace_pixel};
use crate::metric::DEFAULT_RELATIVE;
use crate::path::{self, Device, Path};
use crate::probe::Probed;
use crate::reflect::When;
use crate::value::{Scalar, Shape};

/// A traced pixel: the inputs and the steps of its fragment function.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TracedPixel {
    /// The fragment function of the draw that is visible at the pixel: `scene::fragment`.
    pub function: String,
    /// The arguments by name, as the driver interpolated them.
    pub arguments: Vec<(String, String)>,
    /// Each operation of the function in the engine.
    pub steps: Vec<Step>,
    /// The function's result in the engine.
    pub engine: String,
    /// The pixel's value as the driver drew it.
    pub driver: [f32; 4],
    /// Notes about the trace.
    pub notes: Vec<String>,
}

/// The values of one argument on all pixels.
struct Argument {
    name: String,
    shape: Shape,
    read: Read,
}

impl Argument {
    /// The components of the argument at a pixel, as `u32`s. `None` if the function didn't run for this pixel.
    fn at(&self, pixel: usize) -> Option<&[u32]> {
        let width = self.shape.lanes().len();
        let ran = self.read.times.get(pixel)?.is_some_and(|times| times > 0);
        ran.then(|| &self.read.lanes[pixel * width..][..width])
    }
}

impl Frame<'_> {
    /// Traces the pixel in column `x` and row `y`, counted from 0 at the upper left. A driver interpolates the inputs
    /// of the fragment function. The engine then runs the function with these inputs and the frame's resources.
    ///
    /// ```no_run
    /// use karat::Path;
    /// use karat::prelude::*;
    ///
    /// let text = "@fragment fn fragment(@location(0) uv: vec2f) -> @location(0) vec4f {
    ///     let slope = 2.0 * uv.x;
    ///     return vec4f(slope);
    /// }";
    /// let package = Package::from_source("m", text);
    /// let traced = package.frame("", 4, 4).fragment("fragment").trace(Path::VULKAN, (1, 0))?;
    /// assert_eq!(traced.arguments[0].1, "(0.375, 0.125)");
    /// # Ok::<(), karat::unstable::frame::TapError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if no draw covers the pixel, if the frame can't be drawn, or if the engine can't run the
    /// function.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn trace(&self, path: Path, pixel: (u32, u32)) -> Result<TracedPixel, TapError> {
        self.trace_layer(path, pixel, 1)
    }

    /// Like [`trace`](Self::trace), but for the draw in layer `layer` at the pixel. Layer 1 is the visible draw. Layer
    /// 2 is the draw that would be visible without layer 1, and so on.
    ///
    /// # Errors
    /// As for [`trace`](Self::trace).
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn trace_layer(
        &self,
        path: Path,
        (x, y): (u32, u32),
        layer: u32,
    ) -> Result<TracedPixel, TapError> {
        let executor = executor::of(path).map_err(DrawError::from)?;
        let mut drawing = self.drawing_on(executor)?;
        let size = drawing.size();
        if x >= size.0 || y >= size.1 {
            return Err(TapError::Outside { pixel: (x, y), size });
        }
        if drawing.fragments().is_empty() {
            return Err(TapError::Depth);
        }
        let opened = path::open(path).map_err(DrawError::from)?;
        let device = opened.device().ok_or(DrawError::Unable { path })?;
        let pixel = (y * size.0 + x) as usize;
        let shown = |drawing: &Drawing<'_>| -> Result<usize, TapError> {
            let none = || TapError::Undrawn { pixel: (x, y) };
            if drawing.fragments().is_empty() {
                return Err(none());
            }
            let told = drawing.telling(&[], 0, true)?;
            let seen = device.texels(&told.drawing, &told.targets)?.swap_remove(0);
            Ok(seen[pixel][0].checked_sub(1).ok_or_else(none)? as usize)
        };
        for _ in 1..layer {
            drawing = drawing.without_draw(shown(&drawing)?)?;
        }
        let fragment = drawing.fragments()[shown(&drawing)?].to_owned();
        let function = drawing.program().path_of(&fragment);
        let arguments = arguments(device, &drawing, &fragment)?;

        let scene = drawing.scene();
        let of_module = || match scene.module.is_empty() || function.contains("::") {
            true => function.clone(),
            false => format!("{}::{function}", scene.module),
        };
        let probed = Probed::with_overrides(scene.package, &of_module(), &scene.overrides)?;
        let mut probed = probed.with_varying();
        // Skips the fixtures that only other draws use.
        let own = fixture::resolve(&probed.function().bindings, drawing.fixtures());
        let own = own.map_err(DrawError::from)?.into_iter();
        let fixtures: Fixtures =
            own.map(|(binding, fixture)| (binding.path.clone(), fixture.clone())).collect();
        probed.fit(&fixtures)?;
        let (quad, mut notes) = quad(&probed, &arguments, size, (x, y), path);
        let Pixel { steps, more, results } = trace_pixel(&probed, &fixtures, &quad, place((x, y)))?;
        if more {
            notes.push(format!(
                "an operation that runs more than {BRIEFLY} times is shown only {BRIEFLY} times"
            ));
        }
        if drawing.scene().samples > 1 {
            notes.push(
                "the trace uses the inputs at the pixel's centre, but the frame has several samples per pixel"
                    .to_owned(),
            );
        }
        let driver = drawn(device, &drawing)?.pixels()[pixel];
        notes.extend(compared(&drawing, &probed, &results, driver));
        let shown = arguments.iter().map(|one| {
            let at =
                one.at(pixel).map_or_else(|| "unknown".to_owned(), |lanes| one.shape.format(lanes));
            (one.name.clone(), at)
        });
        Ok(TracedPixel {
            function: of_module(),
            arguments: shown.collect(),
            steps,
            engine: probed.function().result.format(&results),
            driver,
            notes,
        })
    }
}

/// Returns a note if the frame blends colours, or if the driver's colour differs from the engine's colour.
fn compared(
    drawing: &Drawing<'_>,
    probed: &Probed,
    result: &[u32],
    driver: [f32; 4],
) -> Option<String> {
    let scene = drawing.scene();
    if drawing.blends() {
        return Some(
            "the frame blends colours: several draws contribute to the driver's colour, and the trace shows the steps of the last draw"
                .to_owned(),
        );
    }
    let is_colour = *probed.function().result.lanes() == [Scalar::F32; 4];
    if !is_colour || scene.formats != [Format::Float] || scene.result != Source::Target(0) {
        return None;
    }
    let far = |(engine, driver): (&u32, &f32)| {
        let engine = f32::from_bits(*engine);
        let same = engine.to_bits() == driver.to_bits() || (engine.is_nan() && driver.is_nan());
        !(same || (engine - driver).abs() <= DEFAULT_RELATIVE * engine.abs().max(1.0))
    };
    let parts = result.iter().zip(&driver).any(far);
    parts.then(|| {
        "the driver's colour differs from the engine's: look for the first step that isn't finite, or that \
         WGSL doesn't define exactly"
            .to_owned()
    })
}

/// The arguments of a fragment function on all pixels, in the order of the function's parameters.
fn arguments(
    device: &Device,
    drawing: &Drawing<'_>,
    fragment: &str,
) -> Result<Vec<Argument>, TapError> {
    let all = candidates(drawing.program(), &drawing.fragments());
    let own = all.iter().filter(|one| one.value.function == fragment && one.value.range.is_none());
    let own: Vec<(&Candidate, Shape)> =
        own.map(|one| Ok((one, one.shape()?))).collect::<Result<_, TapError>>()?;
    let values: Vec<_> = own.iter().map(|(one, _)| (&one.value, When::Last)).collect();
    let read = read(device, drawing, &values, false)?;
    let told = |((one, shape), read): ((&Candidate, Shape), Read)| Argument {
        name: one.text.clone(),
        shape,
        read,
    };
    Ok(own.into_iter().zip(read).map(told).collect())
}

/// Returns the components of the arguments at each pixel of the quad that contains `(x, y)`. Also returns notes for the
/// user, for example if the arguments of a neighbour are unknown.
fn quad(
    probed: &Probed,
    arguments: &[Argument],
    (width, height): (u32, u32),
    (x, y): (u32, u32),
    path: Path,
) -> ([Vec<u32>; 4], Vec<String>) {
    let mut quad: [Vec<u32>; 4] = Default::default();
    let (own, mut unknown) = (place((x, y)), false);
    for (argument, (_, shape)) in arguments.iter().zip(&probed.function().parameters) {
        let at: [Option<&[u32]>; 4] = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, down)| {
            let (x, y) = ((x & !1) + right, (y & !1) + down);
            (x < width && y < height).then(|| argument.at((y * width + x) as usize)).flatten()
        });
        let here = at[own].unwrap_or_default();
        let [beside, below] = [at[own ^ 1], at[own ^ 2]];
        unknown |= shape.quad().is_some() && (beside.is_none() || below.is_none());
        // A neighbour with unknown values gets the pixel's own values, so derivatives towards that neighbour are 0.
        let [beside, below] = [beside, below].map(|one| one.unwrap_or(here));
        let across = |(index, scalar): (usize, &Scalar)| match scalar.is_float() {
            true => {
                let value = |lanes: &[u32]| f32::from_bits(lanes[index]);
                (value(here) + (value(beside) - value(here)) + (value(below) - value(here)))
                    .to_bits()
            }
            false => here[index],
        };
        let lanes = argument.shape.lanes();
        let across = at[own ^ 3]
            .map_or_else(|| lanes.iter().enumerate().map(across).collect(), <[u32]>::to_vec);
        quad[own].extend(here);
        quad[own ^ 1].extend(beside);
        quad[own ^ 2].extend(below);
        quad[own ^ 3].extend(across);
    }
    let notes = unknown.then(|| {
        format!(
            "another function draws a neighbour in the pixel's quad, so the neighbour's inputs are unknown on {path}: \
             derivatives towards that neighbour are 0 here"
        )
    });
    let alone = (probed.function().form.alone && own != 0).then(|| {
        "the function writes storage, so the engine traces this pixel as the upper left pixel of a quad, whose other \
         pixels are helper invocations"
            .to_owned()
    });
    (quad, notes.into_iter().chain(alone).collect())
}

/// The index of a pixel in its quad: bit 0 is 1 in the right column, and bit 1 is 1 in the lower row.
fn place((x, y): (u32, u32)) -> usize {
    ((x & 1) | (y & 1) << 1) as usize
}
