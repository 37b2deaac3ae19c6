//! Traces one pixel of a frame: the inputs of its fragment function, and each step of that function in the engine.

use super::tap::{Candidate, Read, TapError, candidates, read};
use super::{Frame, drawn};
use crate::draw::{DrawError, Drawing, Format, Source};
use crate::executor;
use crate::fixture::{self, Fixtures};
use crate::interpret::trace::{BRIEFLY, Step, trace_briefly};
use crate::metric::DEFAULT_RELATIVE;
use crate::path::{self, Device, Path};
use crate::probe::Probed;
use crate::reflect::When;
use crate::value::{Scalar, Shape};

/// A pixel, with the inputs and the steps of its fragment function.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct TracedPixel {
    /// The fragment function of the draw that is visible at the pixel: `scene::fragment`.
    pub function: String,
    /// Its arguments by name, as the driver interpolated them.
    pub arguments: Vec<(String, String)>,
    /// Each operation, in the engine.
    pub steps: Vec<Step>,
    /// The result of the function in the engine.
    pub engine: String,
    /// The pixel as the driver drew it.
    pub driver: [f32; 4],
    /// Notes on the values.
    pub notes: Vec<String>,
}

/// An argument, on all pixels.
struct Argument {
    name: String,
    shape: Shape,
    read: Read,
}

impl Argument {
    /// Its lanes at a pixel, if the function ran there.
    fn at(&self, pixel: usize) -> Option<&[u32]> {
        let width = self.shape.lanes().len();
        let ran = self.read.times.get(pixel)?.is_some_and(|times| times > 0);
        ran.then(|| &self.read.lanes[pixel * width..][..width])
    }
}

impl Frame<'_> {
    /// Traces the pixel in column `x` and row `y`, from 0 at the upper left. A driver interpolates the inputs, and the
    /// engine runs the fragment function on them with the frame's resources.
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
    /// If no draw covers the pixel, if the frame can't be drawn, or if the engine can't execute the function.
    ///
    /// *Unstable*: for programs around tests.
    pub fn trace(&self, path: Path, pixel: (u32, u32)) -> Result<TracedPixel, TapError> {
        self.trace_layer(path, pixel, 1)
    }

    /// Like [`trace`](Self::trace), but for any draw that covers the pixel: 1 is the visible one, 2 the one that would
    /// be visible without it, and so on.
    ///
    /// # Errors
    /// The same as for [`trace`](Self::trace).
    ///
    /// *Unstable*: for programs around tests.
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
        // Other draws' fixtures don't belong to this one.
        let own = fixture::resolve(&probed.function().bindings, drawing.fixtures());
        let own = own.map_err(DrawError::from)?.into_iter();
        let fixtures: Fixtures =
            own.map(|(binding, fixture)| (binding.path.clone(), fixture.clone())).collect();
        probed.fit(&fixtures)?;
        let (lanes, mut notes) = lanes(&probed, &arguments, size, (x, y), path);
        let (steps, more) = trace_briefly(&probed, &fixtures, &lanes)?;
        if more {
            notes.push(format!(
                "of an operation that runs more than {BRIEFLY} times the first {BRIEFLY} are shown"
            ));
        }
        let results = executor::call(&probed, Path::CPU, &[lanes], &fixtures)?;
        if drawing.scene().samples > 1 {
            notes.push(
                "the inputs are those at the pixel's centre, and the frame has several samples"
                    .to_owned(),
            );
        }
        let driver = drawn(device, &drawing)?.pixels()[pixel];
        let differs = compared(&drawing, &probed, &results[0], driver);
        notes.extend(differs.is_some().then(|| inside_quad((x, y), &steps)).flatten());
        notes.extend(differs);
        let shown = arguments.iter().map(|one| {
            let at = one
                .at(pixel)
                .map_or_else(|| "not told".to_owned(), |lanes| one.shape.format(lanes));
            (one.name.clone(), at)
        });
        Ok(TracedPixel {
            function: of_module(),
            arguments: shown.collect(),
            steps,
            engine: probed.function().result.format(&results[0]),
            driver,
            notes,
        })
    }
}

/// A note on derivatives. The engine computes them as if the pixel were the first of its quad; the note is for other
/// pixels.
fn inside_quad((x, y): (u32, u32), steps: &[Step]) -> Option<String> {
    let is_derivative =
        |step: &Step| ["dpd", "fwidth", "textureSample("].iter().any(|one| step.text.contains(one));
    ((x | y) & 1 == 1 && steps.iter().any(is_derivative)).then(|| {
        let (x, y) = (x & !1, y & !1);
        format!(
            "derivatives are the driver's in the quad that begins at ({x}, {y}), and the engine takes this pixel for its first: \
             trace that one"
        )
    })
}

/// A note if the driver's colour differs from the engine's.
fn compared(
    drawing: &Drawing<'_>,
    probed: &Probed,
    result: &[u32],
    driver: [f32; 4],
) -> Option<String> {
    let scene = drawing.scene();
    if drawing.blends() {
        return Some(
            "the frame blends: the driver's colour is made of several draws, and these are the steps of the last one"
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
        "the driver drew another colour than the engine returns: look for the first step that isn't finite, or that \
         WGSL leaves open"
            .to_owned()
    })
}

/// The arguments of a fragment function on all pixels, in their order.
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

/// The lanes of a call, with the slopes of the arguments that vary, and the reasons why slopes are unknown.
fn lanes(
    probed: &Probed,
    arguments: &[Argument],
    (width, height): (u32, u32),
    (x, y): (u32, u32),
    path: Path,
) -> (Vec<u32>, Vec<String>) {
    let at = |x: u32, y: u32| (y * width + x) as usize;
    let (mut lanes, mut notes) = (Vec::new(), Vec::new());
    let mut unknown = false;
    for (argument, (_, shape)) in arguments.iter().zip(&probed.function().parameters) {
        let own = argument.at(at(x, y)).unwrap_or_default();
        lanes.extend(own);
        if shape.quad().is_none() {
            continue;
        }
        // The neighbour in the quad: to the right of this pixel or below it, or else to the left or above.
        let others = [(x ^ 1, y, x & 1 == 0), (x, y ^ 1, y & 1 == 0)];
        for (x, y, is_behind) in others {
            let other = (x < width && y < height).then(|| argument.at(at(x, y))).flatten();
            unknown |= other.is_none();
            for (index, scalar) in argument.shape.lanes().iter().enumerate() {
                let slope = other.filter(|_| scalar.is_float()).map_or(0.0, |other| {
                    let [own, other] = [own[index], other[index]].map(f32::from_bits);
                    if is_behind { other - own } else { own - other }
                });
                lanes.push(slope.to_bits());
            }
        }
    }
    if unknown {
        notes.push(format!(
            "a neighbour in the pixel's quad isn't drawn by the same function, so that its inputs aren't known on {path}: \
             derivatives towards it are 0 here"
        ));
    }
    (lanes, notes)
}
