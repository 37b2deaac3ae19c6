//! `karat match`: compares another program's image with a golden.

use std::io::Write;
use std::path::PathBuf;

use anyhow::{Context, ensure};
use karat::golden::GoldenError;
use karat::unstable::output::tell;
use karat::unstable::path::Adapter;
use karat::{Goldens, Image};

use super::goldens::FolderArgs;
use super::project::Project;
use super::table::GOOD;
use super::{Ending, Outcome};

pub(super) const EXAMPLES: &str = "\
Examples:
  karat match menu screenshot.png
  karat match scene frame.exr --by \"Chrome 156\" --goldens e2e/golden
The tolerance is the same as for frames: each channel is within 1e-3, or else HDR-FLIP is at most 0.005 in
the mean and 0.01 in each tile (0.03 if another browser or driver drew the golden). An image that differs from
its golden, or has no golden, becomes pending: see `karat review`, `karat accept` and `karat reject`.
Exit codes: 0 the image matches; 1 the image differs or has no golden; 2 the image can't be read or compared.";

#[derive(clap::Args)]
pub(super) struct Args {
    /// The name of the golden
    name: String,
    /// The image to compare: an EXR, or a PNG, which Karat converts to linear values
    image: PathBuf,
    /// Stores the name of the program that drew the image
    #[arg(long, value_name = "PROGRAM", default_value = "another program")]
    by: String,
    #[command(flatten)]
    folder: FolderArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let image = Image::read(&args.image)?;
    let shows_nothing =
        image.pixels().windows(2).all(|two| two[0].map(f32::to_bits) == two[1].map(f32::to_bits));
    ensure!(
        !shows_nothing,
        "all pixels of the image `{}` have the same colour. A browser without a GPU draws no WebGPU canvas, unless you start \
         the browser with the arguments that `karat-playwright` exports as `webgpu` (see the guide)",
        args.image.display()
    );
    let folder = match args.folder.named() {
        Some(folder) => folder.to_owned(),
        None => Project::find()?.golden(),
    };
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("no folder `{}`", folder.display()))?;
    let (path, name) = ("image".to_owned(), args.by.clone());
    let adapter = Adapter { path, name, driver: String::new(), software: false };
    match Goldens::open(&folder).check_image(&args.name, &image, &adapter) {
        Ok(margin) => {
            writeln!(out, "{GOOD}image {} matches its golden{GOOD:#}: {margin}", args.name)?;
            Ok(Ending::Good)
        }
        Err(error @ (GoldenError::Differs { .. } | GoldenError::Missing { .. })) => {
            tell(&format!("error: {error}"));
            Ok(Ending::Bad)
        }
        Err(error) => Err(error.into()),
    }
}
