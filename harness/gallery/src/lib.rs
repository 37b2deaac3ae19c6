//! Frames of a project by name, and the command line that renders them.
//!
//! Frames are described in Rust, so only a binary of the project can know them. This binary contains only a
//! [`Gallery`]; `karat render` builds and runs it. The binary and `karat render` have the same arguments, which
//! `arguments.rs` defines.

mod arguments;
mod steps;
mod tappable;
mod taps;
mod traced;

use std::error::Error;
use std::io::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path as FilePath, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;

pub use arguments::{DrawArguments, ExposureArguments, RenderArguments, pixel};
pub use steps::{Row, rows};
pub use tappable::{Tappable, tap};
pub use traced::Traced;

use karat::Frame;
use karat::Image;
use karat::Path;
use karat::image::{ImageError, Precision};
use karat::path::PathError;
use karat::unstable::diagnostic::{nearest, shown};
use karat::unstable::frame::Tap;
use karat::unstable::golden::build_output;
use karat::unstable::image::NonFinite;
use karat::unstable::output::{Output, Style, counted};
use karat::unstable::path;

const BAD: Style = Style::BAD;
const HEAD: Style = Style::HEAD;

/// The settings for rendering a frame. A frame may ignore some of them.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RenderOptions {
    /// The width and height in pixels, each from 1 to 16384. `None` means the frame's own size.
    pub size: Option<(u32, u32)>,
    /// The number of samples per pixel, at least 1. A frame may give this number another meaning. `None` means the
    /// frame's own number.
    pub samples: Option<u32>,
    /// A file with the light around the scene, such as an EXR panorama. The file existed when the options were read.
    /// `None` means the frame's own light.
    pub environment: Option<PathBuf>,
    /// The path on which the frame is drawn. Karat has already checked that the path is available.
    pub path: Path,
}

impl RenderOptions {
    /// Returns options that set only the path. The frame chooses all other values.
    #[must_use]
    pub fn new(path: Path) -> Self {
        Self { size: None, samples: None, environment: None, path }
    }

    /// Returns the requested size, or `width` and `height` if no size is requested.
    #[must_use]
    pub fn size_or(&self, width: u32, height: u32) -> (u32, u32) {
        self.size.unwrap_or((width, height))
    }

    /// Returns the requested number of samples, or `samples` if no number is requested.
    #[must_use]
    pub fn samples_or(&self, samples: u32) -> u32 {
        self.samples.unwrap_or(samples)
    }
}

type Describe = dyn Fn(&RenderOptions) -> Result<Frame<'static>, Box<dyn Error>>;

struct Entry {
    name: String,
    about: String,
    describe: Box<Describe>,
}

/// The frames of a project, for rendering from the command line.
///
/// ```no_run
/// // frames/main.rs, a [[bin]] named `gallery`
/// static SHADERS: karat::Package = karat::package!("shaders");
///
/// fn main() -> std::process::ExitCode {
///     karat_gallery::Gallery::new()
///         .frame("sky", "the sky at noon", |options| {
///             let (width, height) = options.size_or(640, 360);
///             Ok(SHADERS.frame("sky", width, height).fullscreen("vertex", "fragment"))
///         })
///         .main()
/// }
/// ```
///
/// The project names the binary in its Cargo.toml, where `karat render` finds it:
///
/// ```toml
/// [workspace.metadata.karat] # or package.metadata.karat
/// gallery = "gallery"
/// ```
#[derive(Default)]
#[must_use = "a gallery renders its frames when you call `.main()`"]
pub struct Gallery {
    entries: Vec<Entry>,
}

/// The reason why a gallery failed. If a single frame can't be rendered, the gallery doesn't fail.
#[derive(Debug, thiserror::Error)]
enum GalleryError {
    #[error("the gallery has no frame; add one with `.frame(...)`")]
    Empty,
    #[error("`{0}` can't name a frame: use letters, digits, `-`, `_` and `/`")]
    Name(String),
    #[error("the gallery has two frames with the name `{0}`")]
    Twice(String),
    #[error("no frame is selected: name a frame, or use --first or --all; the frames are\n{0}")]
    NoneNamed(String),
    #[error("the gallery has no frame `{name}`{}",
        nearest.as_ref().map_or_else(
            || format!("; its frames are {}", names.join(", ")),
            |name| format!("; did you mean `{name}`?"),
        ))]
    Unknown { name: String, nearest: Option<String>, names: Vec<String> },
    #[error("only one frame can be traced: name one frame")]
    OneTraced,
    #[error("can't write into `{folder}`: {cause}")]
    Out { folder: String, cause: io::Error },
    #[error(transparent)]
    Path(#[from] PathError),
    #[error(transparent)]
    Image(#[from] ImageError),
    #[error(transparent)]
    Output(#[from] io::Error),
}

#[derive(Parser)]
#[command(
    name = "gallery",
    about = "Renders this project's frames as EXR (linear, 32-bit float) and PNG (to look at).",
    after_help = "`karat render` builds this program and runs it with the same arguments."
)]
struct Standalone {
    #[command(flatten)]
    arguments: RenderArguments,
}

impl Gallery {
    /// Makes a gallery without frames.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a frame. The frame that you add first counts as the project's scene. `name` becomes the name of the frame's
    /// files: use letters, digits, `-`, `_` and `/`. `about` says in one line what the frame shows. The gallery calls
    /// `describe` when it renders the frame.
    pub fn frame(
        mut self,
        name: &str,
        about: &str,
        describe: impl Fn(&RenderOptions) -> Result<Frame<'static>, Box<dyn Error>> + 'static,
    ) -> Self {
        let (name, about) = (name.to_owned(), about.to_owned());
        self.entries.push(Entry { name, about, describe: Box::new(describe) });
        self
    }

    /// Runs the gallery with the arguments of the process. Returns 0 if all is well, 1 if a frame can't be rendered or
    /// has values that are not finite, and 2 if the gallery couldn't start.
    #[must_use = "return it from `main`"]
    pub fn main(self) -> ExitCode {
        let Standalone { arguments } = Standalone::parse();
        let (mut out, mut err) = (Output::stdout(), Output::stderr());
        // A closed output doesn't affect the frames.
        let result = self.run(&arguments, &mut out, &mut err);
        match result.and_then(|failed| Ok(out.finish().map(|()| failed)?)) {
            Ok(failed) if failed.is_empty() => ExitCode::SUCCESS,
            Ok(_) => ExitCode::from(1),
            Err(error) => {
                // If stderr is closed, the error can't be shown.
                drop(report(&mut err, "", &error));
                ExitCode::from(2)
            }
        }
    }

    /// Runs the gallery. Returns the names of the frames with a problem.
    fn run(
        &self,
        arguments: &RenderArguments,
        out: &mut dyn Write,
        err: &mut dyn Write,
    ) -> Result<Vec<&str>, GalleryError> {
        self.check_names()?;
        if arguments.list {
            write!(out, "{}", self.list(HEAD))?;
            return Ok(Vec::new());
        }
        let selected = self.select(arguments)?;
        let folder = arguments.drawn.out.clone().unwrap_or_else(output);
        let options = arguments.options(open(arguments.drawn.path)?);
        prepare(&folder).map_err(|cause| GalleryError::Out { folder: shown(&folder), cause })?;
        if let Some(values) = &arguments.tap {
            let tap =
                |value: &String| Tap::new(value).round(arguments.round).beside(arguments.beside);
            let taps: Vec<Tap> = values.iter().map(tap).collect();
            return tapped(&selected, &options, &folder, (&taps, &arguments.at), (out, err));
        }
        if let Some(pixel) = arguments.trace {
            let layer = arguments.layer.unwrap_or(1);
            return traced(&selected, &options, (pixel, layer), (out, err));
        }
        let width = selected.iter().map(|entry| entry.name.len()).max().unwrap_or(0);
        let mut failed = Vec::new();
        for entry in &selected {
            let name = &entry.name;
            let start = Instant::now();
            let image = match entry.render(&options) {
                Ok(image) => image,
                Err(error) => {
                    failed.push(name.as_str());
                    report(err, &format!("frame `{name}` can't be rendered"), &*error)?;
                    continue;
                }
            };
            let seconds = start.elapsed().as_secs_f64();
            let exr = folder.join(format!("{name}.exr"));
            let png = folder.join(format!("{name}.png"));
            image.write_exr(&exr, Precision::Float, None)?;
            image.write_png_exposed(&png, arguments.exposure.stops)?;
            let (size, path) = ((image.width(), image.height()), options.path);
            writeln!(
                out,
                "{HEAD}{name:<width$}{HEAD:#}  {} x {}  {path}  {seconds:.2} s  {}  {}",
                size.0,
                size.1,
                shown(&exr),
                shown(&png)
            )?;
            out.flush()?;
            if options.size.is_some_and(|asked| asked != size) {
                writeln!(err, "note: frame `{name}` has a fixed size and ignores --size")?;
            }
            if let NonFinite { nan, infinite, first: Some((column, row)) } = image.non_finite() {
                failed.push(name);
                writeln!(
                    err,
                    "{BAD}warning{BAD:#}: frame `{name}` has {} with NaN and {infinite} \
                     with infinities, the first one in column {column}, row {row}",
                    counted(nan, "pixel")
                )?;
            }
        }
        if !failed.is_empty() && selected.len() > 1 {
            let (bad, all) = (failed.len(), selected.len());
            writeln!(err, "{bad} of {all} frames failed: {}", failed.join(", "))?;
        }
        Ok(failed)
    }

    /// Checks that each name is a valid file name, and that no two frames have the same name.
    fn check_names(&self) -> Result<(), GalleryError> {
        let sound = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
        for (index, Entry { name, .. }) in self.entries.iter().enumerate() {
            if !name.split('/').all(|part| !part.is_empty() && part.chars().all(sound)) {
                return Err(GalleryError::Name(name.clone()));
            }
            if self.entries[..index].iter().any(|before| before.name == *name) {
                return Err(GalleryError::Twice(name.clone()));
            }
        }
        if self.entries.is_empty() { Err(GalleryError::Empty) } else { Ok(()) }
    }

    /// Lists the frames, one in each line.
    fn list(&self, style: Style) -> String {
        let width = self.entries.iter().map(|entry| entry.name.len()).max().unwrap_or(0);
        let line = |Entry { name, about, .. }: &Entry| {
            format!("{style}{name:<width$}{style:#}  {about}").trim_end().to_owned() + "\n"
        };
        self.entries.iter().map(line).collect()
    }

    /// Returns the requested frames in the gallery's order. Returns at least one frame.
    fn select(&self, arguments: &RenderArguments) -> Result<Vec<&Entry>, GalleryError> {
        if arguments.all {
            return Ok(self.entries.iter().collect());
        }
        if arguments.first {
            return Ok(self.entries.iter().take(1).collect());
        }
        if arguments.frames.is_empty() {
            return Err(GalleryError::NoneNamed(self.list(Style::PLAIN).trim_end().to_owned()));
        }
        let mut wanted = vec![false; self.entries.len()];
        for pattern in &arguments.frames {
            let glob = glob::Pattern::new(pattern).ok();
            let mut found = false;
            for (wanted, Entry { name, .. }) in wanted.iter_mut().zip(&self.entries) {
                let matches = name == pattern || glob.as_ref().is_some_and(|g| g.matches(name));
                *wanted |= matches;
                found |= matches;
            }
            if !found {
                let names: Vec<_> = self.entries.iter().map(|entry| entry.name.clone()).collect();
                let near = nearest(pattern, names.iter().map(String::as_str)).map(str::to_owned);
                return Err(GalleryError::Unknown { name: pattern.clone(), nearest: near, names });
            }
        }
        let chosen = self.entries.iter().zip(wanted).filter(|(_, wanted)| *wanted);
        Ok(chosen.map(|(entry, _)| entry).collect())
    }
}

/// Prints as JSON the steps by which the selected frame computes a pixel.
fn traced<'e>(
    selected: &[&'e Entry],
    options: &RenderOptions,
    (pixel, layer): ((u32, u32), u32),
    (out, err): (&mut dyn Write, &mut dyn Write),
) -> Result<Vec<&'e str>, GalleryError> {
    let [entry] = *selected else { return Err(GalleryError::OneTraced) };
    let trace =
        |frame: Frame<'static>| Ok(Traced::from(frame.trace_layer(options.path, pixel, layer)?));
    match entry.described(options, trace) {
        Ok(traced) => {
            // The line is written in one piece, because the reader searches for the last line end.
            let line = serde_json::json!(traced).to_string() + "\n";
            out.write_all(line.as_bytes())?;
            Ok(Vec::new())
        }
        Err(error) => {
            report(err, &format!("frame `{}`", entry.name), &*error)?;
            Ok(vec![&entry.name])
        }
    }
}

/// Prints values of frames. Returns the names of the frames that don't have these values, or that Karat can't render.
fn tapped<'e>(
    selected: &[&'e Entry],
    options: &RenderOptions,
    folder: &FilePath,
    taps: (&[Tap], &[(u32, u32)]),
    (out, err): (&mut dyn Write, &mut dyn Write),
) -> Result<Vec<&'e str>, GalleryError> {
    let mut failed = Vec::new();
    for entry in selected {
        let name = entry.name.as_str();
        let told =
            entry.described(options, |frame| tap(&frame, name, folder, options.path, taps, out));
        if let Err(error) = told {
            failed.push(name);
            report(err, &format!("frame `{name}`"), &*error)?;
        }
    }
    Ok(failed)
}

impl Entry {
    /// Returns the result of `make` for the frame. A panic in the frame's code becomes an error.
    fn described<T>(
        &self,
        options: &RenderOptions,
        make: impl FnOnce(Frame<'static>) -> Result<T, Box<dyn Error>>,
    ) -> Result<T, Box<dyn Error>> {
        // A panic concerns only this frame: the gallery still renders the others. The hook has already printed the
        // message.
        catch_unwind(AssertUnwindSafe(|| make((self.describe)(options)?)))
            .unwrap_or_else(|_| Err("the frame's code panicked: see the message above".into()))
    }

    fn render(&self, options: &RenderOptions) -> Result<Image, Box<dyn Error>> {
        self.described(options, |frame| Ok(frame.render(options.path)?))
    }
}

/// Returns the requested path, or the first path on which checks run.
///
/// # Errors
/// Returns an error if the path isn't available.
pub fn open(asked: Option<Path>) -> Result<Path, PathError> {
    let Some(path) = asked else {
        let selected = path::selected()?;
        return Ok(*selected.first().expect("a selection is never empty"));
    };
    path::required(path).map(|_| path)
}

/// Returns the default folder for frames: Cargo's target folder, which Cargo excludes from backups. If Cargo didn't
/// build this program, returns a folder below the working directory.
fn output() -> PathBuf {
    build_output().join("karat/frames")
}

/// Makes the folder and tries to write into it, so that an unusable folder is reported before frames are rendered.
fn prepare(folder: &FilePath) -> io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let probe = folder.join(format!(".karat{}", std::process::id()));
    std::fs::write(&probe, "")?;
    std::fs::remove_file(&probe)
}

/// Prints an error, and the underlying causes that the error's text doesn't mention.
fn report(err: &mut dyn Write, what: &str, error: &dyn Error) -> io::Result<()> {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let reason = error.to_string();
        if !text.contains(&reason) {
            text = format!("{text}: {reason}");
        }
        cause = error.source();
    }
    // A diagnostic has its own headline, and is printed below.
    match (what.is_empty(), text.starts_with("error")) {
        (true, true) => writeln!(err, "{text}"),
        (true, false) => writeln!(err, "{BAD}error{BAD:#}: {text}"),
        (false, true) => writeln!(err, "{BAD}error{BAD:#}: {what}\n{text}"),
        (false, false) => writeln!(err, "{BAD}error{BAD:#}: {what}: {text}"),
    }
}

#[cfg(test)]
mod tests;
