//! The arguments of `karat render` and of galleries. `karat render` parses these arguments, and passes them on to the
//! gallery that it runs.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::builder::{PathBufValueParser, TypedValueParser};

use super::RenderOptions;
use karat::path::Path;

/// The longest side of a frame in pixels. Images that Karat reads have the same limit.
const LONGEST_SIDE: u32 = 16_384;

/// The frames to render, and the settings.
#[derive(clap::Args, Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct RenderArguments {
    /// Names or globs of frames
    #[arg(value_name = "FRAME")]
    pub(super) frames: Vec<String>,
    /// Renders the first frame of the gallery: the project's scene
    #[arg(long, conflicts_with_all = ["frames", "all", "list"])]
    pub(super) first: bool,
    /// Prints the names and descriptions of the frames
    #[arg(long, conflicts_with_all = ["frames", "all"])]
    pub(super) list: bool,
    /// Renders every frame
    #[arg(long, conflicts_with = "frames")]
    pub(super) all: bool,
    #[command(flatten)]
    pub(super) drawn: DrawArguments,
    #[command(flatten)]
    pub(super) exposure: ExposureArguments,
    /// Values to print in place of the frame: see `karat tap`
    #[arg(long, hide = true, value_name = "VALUE", num_args = 0..=1)]
    pub(super) tap: Option<Vec<String>>,
    /// If a pixel computes the values several times, prints the values of the computation with this number
    #[arg(long, hide = true, value_name = "N", requires = "tap")]
    pub(super) round: Option<u32>,
    /// Also draws the frame's colours
    #[arg(long, hide = true, requires = "tap")]
    pub(super) beside: bool,
    /// A pixel for which Karat also prints the engine's value
    #[arg(long, hide = true, value_name = "X,Y", value_parser = pixel, requires = "tap")]
    pub(super) at: Vec<(u32, u32)>,
    /// A pixel whose steps to print as JSON: see `karat trace`
    #[arg(long, hide = true, value_name = "X,Y", value_parser = pixel, conflicts_with = "tap")]
    pub(super) trace: Option<(u32, u32)>,
    /// The number of the draw to trace at this pixel, counted from the visible draw
    #[arg(long, hide = true, value_name = "N", requires = "trace")]
    pub(super) layer: Option<u32>,
}

/// The settings for drawing frames, and the folder for the images.
#[derive(clap::Args, Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct DrawArguments {
    /// Writes the images into this folder [default: `karat/frames` in Cargo's target folder]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Sets width and height in pixels, such as 640x360 [default: the frame's own]
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub size: Option<(u32, u32)>,
    /// Sets the samples per pixel, or another count that the frame defines, at least 1 [default: the frame's own]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub samples: Option<u32>,
    /// Sets the light around the scene, such as an EXR panorama, for frames that use such a file
    #[arg(
        long,
        value_name = "FILE",
        value_parser = PathBufValueParser::new().try_map(existing_file)
    )]
    pub environment: Option<PathBuf>,
    /// Renders on this path: `vulkan`, `gl`, ... [default: the first path that tests run on]
    #[arg(long, value_name = "PATH")]
    pub path: Option<Path>,
}

/// The brightness of a preview.
#[derive(clap::Args, Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct ExposureArguments {
    /// Adds this number of stops to the automatic exposure of the PNG: 1 is twice as bright, -1 half as bright. The
    /// EXR stays linear
    #[arg(
        long = "exposure",
        value_name = "STOPS",
        value_parser = stops,
        default_value_t = 0.0,
        hide_default_value = true,
        allow_hyphen_values = true
    )]
    pub stops: f32,
}

impl RenderArguments {
    /// Sets the folder for the images, unless it is already set.
    #[must_use]
    pub fn out_or(mut self, folder: PathBuf) -> Self {
        self.drawn.out.get_or_insert(folder);
        self
    }

    /// Returns arguments that print values of a frame, with the engine's values at some pixels. If `values` is empty,
    /// the gallery lists the names of the frame's values.
    #[must_use]
    pub fn tapping(
        frame: &str,
        values: Vec<String>,
        (round, beside, at): (Option<u32>, bool, Vec<(u32, u32)>),
        drawn: DrawArguments,
    ) -> Self {
        let (frames, tap) = (vec![frame.to_owned()], Some(values));
        Self { frames, tap, round, beside, at, drawn, ..Self::default() }
    }

    /// Returns arguments that trace a pixel of a frame.
    #[must_use]
    pub fn tracing(frame: &str, pixel: (u32, u32), layer: u32, drawn: DrawArguments) -> Self {
        let (frames, trace, layer) = (vec![frame.to_owned()], Some(pixel), Some(layer));
        Self { frames, trace, layer, drawn, ..Self::default() }
    }

    /// Returns the arguments in the form of a command line.
    #[must_use]
    pub fn words(&self) -> Vec<OsString> {
        // The pattern names all fields, so that the code forgets none.
        let Self {
            frames,
            first,
            list,
            all,
            drawn,
            exposure,
            tap,
            round,
            beside,
            at,
            trace,
            layer,
        } = self;
        let DrawArguments { out, size, samples, environment, path } = drawn;
        let mut words: Vec<OsString> = Vec::new();
        let flags = [("--first", first), ("--list", list), ("--all", all), ("--beside", beside)];
        words.extend(flags.iter().filter(|(_, on)| **on).map(|(flag, _)| flag.into()));
        // Option and value are one argument, so that a value can't be mistaken for an option.
        let mut option = |name: &str, value: OsString| {
            let mut word = OsString::from(format!("--{name}="));
            word.push(value);
            words.push(word);
        };
        if let Some(out) = out {
            option("out", out.into());
        }
        if let Some((width, height)) = size {
            option("size", format!("{width}x{height}").into());
        }
        if let Some(samples) = samples {
            option("samples", samples.to_string().into());
        }
        option("exposure", exposure.stops.to_string().into());
        if let Some(environment) = environment {
            option("environment", environment.into());
        }
        if let Some(path) = path {
            option("path", path.name().into());
        }
        match tap.as_deref() {
            Some([]) => words.push("--tap".into()),
            Some(values) => {
                words.extend(values.iter().map(|value| format!("--tap={value}").into()))
            }
            None => {}
        }
        if let Some(round) = round {
            words.push(format!("--round={round}").into());
        }
        words.extend(at.iter().map(|(x, y)| format!("--at={x},{y}").into()));
        if let Some((x, y)) = trace {
            words.push(format!("--trace={x},{y}").into());
            words.extend(layer.map(|layer| format!("--layer={layer}").into()));
        }
        words.push("--".into());
        words.extend(frames.iter().map(Into::into));
        words
    }

    /// Returns the options for the frames.
    pub(super) fn options(&self, path: Path) -> RenderOptions {
        let DrawArguments { size, samples, environment, .. } = self.drawn.clone();
        RenderOptions { size, samples, environment, path }
    }
}

/// Parses a pixel, such as `120,64`: its column and its row, from 0.
///
/// # Errors
/// Returns an error if the text isn't a pixel.
pub fn pixel(text: &str) -> Result<(u32, u32), String> {
    let found = text
        .split_once(',')
        .and_then(|(x, y)| Some((x.trim().parse().ok()?, y.trim().parse().ok()?)));
    found.ok_or_else(|| {
        format!("`{text}` isn't a pixel: write the pixel's column and row, as in 120,64")
    })
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let form = || format!("`{text}` isn't a size: write width x height in pixels, as in 640x360");
    let (width, height) = text.split_once('x').ok_or_else(form)?;
    let side = |digits: &str| {
        if digits.is_empty() || !digits.bytes().all(|digit| digit.is_ascii_digit()) {
            return Err(form());
        }
        // A number that overflows is also out of range.
        match digits.parse() {
            Ok(side) if (1..=LONGEST_SIDE).contains(&side) => Ok(side),
            _ => Err(format!(
                "the image can't have a side of {digits} pixels: write 1 to {LONGEST_SIDE} pixels"
            )),
        }
    };
    Ok((side(width)?, side(height)?))
}

fn stops(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(stops) if stops.is_finite() => Ok(stops),
        _ => Err(format!("`{text}` isn't a finite number of stops")),
    }
}

fn existing_file(file: PathBuf) -> Result<PathBuf, String> {
    if file.is_file() {
        return Ok(file);
    }
    Err(if file.exists() { "the path isn't a file" } else { "there is no such file" }.to_owned())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        arguments: RenderArguments,
    }

    fn parse<T: Into<OsString> + Clone>(words: &[T]) -> Result<RenderArguments, String> {
        let words = words.iter().cloned().map(Into::into);
        let line = Line::try_parse_from([OsString::from("gallery")].into_iter().chain(words));
        line.map(|line| line.arguments).map_err(|error| error.to_string())
    }

    #[test]
    fn arguments_are_the_same_when_they_are_passed_on() {
        let environment = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"); // any file
        for words in [
            &[][..],
            &["--first"],
            &["--list"],
            &["--all", "--exposure", "-0.1"],
            &["scene", "furnace/*", "--size", "640x360", "--samples", "4294967295"],
            &["scene", "--size", "1x16384", "--path", "gl", "--environment", environment],
            &["--out", "a folder", "--exposure=1e-30", "--", "--first"],
            &["--out=--all", "--exposure", "1.5", "a[0]"],
            &["scene", "--tap", "--beside"],
            &["scene", "--tap=x", "--at=3,4", "--at", "5,6"],
            &["scene", "--trace=3,4"],
            &["--tap=-x", "--tap=a < b", "--round=2", "scene"],
        ] {
            let arguments = parse(words).unwrap_or_else(|error| panic!("{words:?}: {error}"));
            assert_eq!(parse(&arguments.words()), Ok(arguments), "{words:?}");
        }
    }

    #[test]
    fn each_argument_reaches_its_place() {
        let words = ["a", "b", "--size", "3x2", "--samples", "7", "--exposure", "-2", "--path=gl"];
        let arguments = parse(&words).expect("good");
        assert_eq!(arguments.frames, ["a", "b"]);
        assert_eq!(arguments.exposure.stops, -2.0);
        let options = arguments.options(Path::GL);
        assert_eq!((options.size_or(9, 9), options.samples_or(9)), ((3, 2), 7));
        assert_eq!((arguments.drawn.path, options.path), (Some(Path::GL), Path::GL));
        let folder = |arguments: RenderArguments| arguments.out_or("default".into()).drawn.out;
        assert_eq!(folder(arguments), Some("default".into()));
        assert_eq!(folder(parse(&["--out", "own"]).expect("good")), Some("own".into()));
        let options = RenderOptions::new(Path::GL);
        assert_eq!((options.size_or(9, 8), options.samples_or(5)), ((9, 8), 5));
    }

    #[test]
    fn bad_arguments_are_explained() {
        for (words, message) in [
            (
                &["--size", "0x5"][..],
                "the image can't have a side of 0 pixels: write 1 to 16384 pixels",
            ),
            (&["--size", "5x16385"], "the image can't have a side of 16385 pixels: write"),
            (&["--size", "5x99999999999"], "the image can't have a side of 99999999999 pixels"),
            (
                &["--size", "640"],
                "`640` isn't a size: write width x height in pixels, as in 640x360",
            ),
            (&["--size", "640X360"], "`640X360` isn't a size"),
            (&["--size", "640x"], "`640x` isn't a size"),
            (&["--size", "-1x5"], "unexpected argument '-1'"),
            (&["--size=-1x5"], "`-1x5` isn't a size"),
            (&["--size", "+1x5"], "`+1x5` isn't a size"),
            (&["--size", "1x2x3"], "`1x2x3` isn't a size"),
            (&["--samples", "0"], "0 is not in 1.."),
            (&["--samples", "many"], "invalid digit"),
            (&["--samples", "4294967296"], "4294967296 is not in 1..=4294967295"),
            (&["--exposure", "NaN"], "`NaN` isn't a finite number of stops"),
            (&["--exposure", "-inf"], "`-inf` isn't a finite number of stops"),
            (&["--exposure", "1e39"], "`1e39` isn't a finite number of stops"),
            (&["--exposure", "bright"], "`bright` isn't a finite number of stops"),
            (&["--environment", "no/sky.exr"], "there is no such file"),
            (&["--environment", "."], "the path isn't a file"),
            (&["scene", "--round", "2"], "required arguments were not provided"),
            (
                &["--trace", "3"],
                "`3` isn't a pixel: write the pixel's column and row, as in 120,64",
            ),
            (&["--path", "vulcan"], "did you mean `vulkan`?"),
            (&["--first", "scene"], "cannot be used with"),
            (&["--first", "--all"], "cannot be used with"),
            (&["--list", "scene"], "cannot be used with"),
            (&["--all", "scene"], "cannot be used with"),
        ] {
            let error = parse(words).expect_err("refused");
            assert!(error.contains(message), "{words:?}: {error}");
        }
    }
}
