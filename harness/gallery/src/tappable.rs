//! Prints values that a frame or a pass computes, with the engine's values for comparison.

use std::error::Error;
use std::io::Write;
use std::path::Path as FilePath;

use karat::compute::Compute;
use karat::unstable::frame::{Tap, TapError, Tapped};
use karat::unstable::trace::Step;
use karat::{Frame, Path};

use crate::steps::rows;
use crate::taps::write_tapped;

/// A frame, or the passes of a test, with values that Karat can print.
pub trait Tappable {
    /// Lists the named values of the shader, each in one line.
    ///
    /// # Errors
    /// Returns an error if the frame or pass isn't valid.
    fn values(&self, path: Path) -> Result<Vec<String>, Box<dyn Error>>;

    /// Lists the locations of the shader's lines that print a value (`//karat: print x`).
    ///
    /// # Errors
    /// Returns an error if the frame or pass isn't valid.
    fn prints(&self, path: Path) -> Result<Vec<String>, Box<dyn Error>>;

    /// Returns the requested values.
    ///
    /// # Errors
    /// Returns an error if a value doesn't exist, or if the frame or pass can't run on the path.
    fn taps(&self, path: Path, taps: &[Tap]) -> Result<Vec<Tapped>, Box<dyn Error>>;

    /// Returns the engine's value at a pixel or an invocation, as text.
    ///
    /// # Errors
    /// Returns an error if the engine can't run the frame or pass.
    fn engine(
        &self,
        path: Path,
        tap: &Tap,
        tapped: &Tapped,
        at: (u32, u32),
    ) -> Result<String, Box<dyn Error>>;
}

impl Tappable for Frame<'_> {
    fn values(&self, path: Path) -> Result<Vec<String>, Box<dyn Error>> {
        Ok(Frame::values(self, path)?)
    }

    fn prints(&self, path: Path) -> Result<Vec<String>, Box<dyn Error>> {
        Ok(Frame::prints(self, path)?)
    }

    fn taps(&self, path: Path, taps: &[Tap]) -> Result<Vec<Tapped>, Box<dyn Error>> {
        Ok(Frame::taps(self, path, taps)?)
    }

    fn engine(
        &self,
        path: Path,
        _: &Tap,
        tapped: &Tapped,
        at: (u32, u32),
    ) -> Result<String, Box<dyn Error>> {
        if tapped.name.as_ref().is_some_and(|name| name.contains(['.', '['])) {
            return Ok("the engine shows only whole values: remove the component, member or index from the name".to_owned());
        }
        let traced = self.trace(path, at)?;
        let steps = traced.steps;
        let is_it = |step: &&Step| {
            let (own, wanted) = (&step.span, &tapped.span);
            (&own.file.name, own.range.start, &step.text)
                == (&wanted.file.name, wanted.range.start, &tapped.text)
        };
        let found: Vec<&Step> = steps.iter().filter(is_it).collect();
        let times = tapped.times[index(tapped, at)].unwrap_or(0) as usize;
        let wanted = tapped.round.map_or(times, |round| round as usize);
        let step = match (found.get(wanted.wrapping_sub(1)), found.len()) {
            (Some(step), _) => (*step).clone(),
            (None, 0) => {
                return Ok(
                    "the engine shows only results of operations, but this value is a parameter, a call, a constructor, or a value that the result doesn't need"
                        .to_owned(),
                );
            }
            (None, shown) => {
                return Ok(format!(
                    "the pixel computes the value {times} times, but the engine shows only the first {shown} of these computations: select one of them with --round"
                ));
            }
        };
        // A step with another number of components has only a part of the value.
        if step.single.len() != tapped.shape.lanes().len() {
            return Ok(format!(
                "in the engine, one step computes only {} of the value's components: `karat trace` shows all steps",
                step.single.len()
            ));
        }
        let row = rows(&[step]).swap_remove(0);
        let allowed = match row.allowed.as_str() {
            "not known" => String::new(),
            allowed => format!(", WGSL allows {allowed}"),
        };
        Ok(format!("{} in the engine; {} in f64{allowed}", row.single, row.double))
    }
}

impl Tappable for Compute<'_> {
    fn values(&self, _: Path) -> Result<Vec<String>, Box<dyn Error>> {
        Ok(Compute::values(self)?)
    }

    fn prints(&self, _: Path) -> Result<Vec<String>, Box<dyn Error>> {
        Ok(Compute::prints(self)?)
    }

    fn taps(&self, path: Path, taps: &[Tap]) -> Result<Vec<Tapped>, Box<dyn Error>> {
        let mut all = Vec::new();
        for tap in taps {
            all.push(Compute::tap(self, path, tap)?);
        }
        Ok(all)
    }

    fn engine(
        &self,
        _: Path,
        tap: &Tap,
        _: &Tapped,
        at: (u32, u32),
    ) -> Result<String, Box<dyn Error>> {
        Ok(format!("{} in the engine", value(&Compute::tap(self, Path::CPU, tap)?, at)))
    }
}

/// Writes values of a frame or of passes, each with the engine's value at the given pixels or invocations. If no values
/// are requested, lists the values.
///
/// # Errors
/// Returns an error if a value doesn't exist, if the frame or pass can't run, or if an image can't be written.
pub fn tap(
    subject: &dyn Tappable,
    name: &str,
    folder: &FilePath,
    path: Path,
    (taps, pixels): (&[Tap], &[(u32, u32)]),
    out: &mut dyn Write,
) -> Result<(), Box<dyn Error>> {
    let mut all: Vec<Tap> = Vec::new();
    for tap in taps {
        let places = if tap.is_of_prints() { subject.prints(path)? } else { Vec::new() };
        match (tap.is_of_prints(), places.is_empty()) {
            (true, true) => {
                return Err(
                    "the shader has no line that prints a value: write `//karat: print x`".into()
                );
            }
            (true, false) => all.extend(places.iter().map(|place| tap.of(place))),
            (false, _) => all.push(tap.clone()),
        }
    }
    if taps.is_empty() {
        let values = subject.values(path)?;
        for line in &values {
            writeln!(out, "{line}")?;
        }
        if values.is_empty() {
            writeln!(
                out,
                "the shader has no `let` and no parameter: name an expression of the shader, such as `a + b`"
            )?;
        }
    }
    for (tap, tapped) in all.iter().zip(subject.taps(path, &all)?) {
        write_tapped(folder, name, &tapped, out)?;
        for pixel in pixels {
            let (x, y) = *pixel;
            if x >= tapped.size.0 || y >= tapped.size.1 {
                return Err(TapError::Outside { pixel: *pixel, size: tapped.size }.into());
            }
            let driver = value(&tapped, *pixel);
            let engine = match tapped.told[index(&tapped, *pixel)] {
                true => subject.engine(path, tap, &tapped, *pixel)?,
                false => "the engine shows no value there".to_owned(),
            };
            writeln!(out, "    at ({x}, {y}): {driver} on {path}; {engine}")?;
        }
        out.flush()?;
    }
    Ok(())
}

fn index(tapped: &Tapped, (x, y): (u32, u32)) -> usize {
    (y * tapped.size.0 + x) as usize
}

/// Formats the value at a pixel or an invocation.
fn value(tapped: &Tapped, at: (u32, u32)) -> String {
    let (index, width) = (index(tapped, at), tapped.shape.lanes().len());
    match tapped.told.get(index) {
        Some(true) => tapped.shape.format(&tapped.lanes[index * width..][..width]),
        _ => "not computed".to_owned(),
    }
}
