//! `karat preview`

use std::io::Write;
use std::path::PathBuf;

use karat::Image;
use karat_gallery::ExposureArguments;

use super::{Ending, Outcome, spare};

#[derive(clap::Args)]
pub(super) struct Args {
    /// The EXR image
    image: PathBuf,
    /// Writes the PNG to this file [default: beside the image]
    #[arg(long, value_name = "OUT.PNG")]
    out: Option<PathBuf>,
    #[command(flatten)]
    exposure: ExposureArguments,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let path = args.out.clone().unwrap_or_else(|| args.image.with_extension("png"));
    spare("preview", &path, [args.image.as_path()])?;
    let (image, _) = Image::read_exr(&args.image)?;
    image.write_png_exposed(&path, args.exposure.stops)?;
    writeln!(out, "{}", path.display())?;
    Ok(Ending::Good)
}
