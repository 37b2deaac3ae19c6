//! Draws the frames of the shader library for `karat render`.

use std::error::Error;
use std::path::Path as FilePath;
use std::process::ExitCode;

use frames::{ENVIRONMENT, FRAMES, Shot, frame};
use karat::{CubeMap, Image};
use karat_gallery::{Gallery, RenderOptions};

fn main() -> ExitCode {
    let gallery = FRAMES.into_iter().fold(Gallery::new(), |gallery, (name, about)| {
        gallery.frame(name, about, move |options| frame(name, &shot(options)?))
    });
    gallery.main()
}

fn shot(options: &RenderOptions) -> Result<Shot, Box<dyn Error>> {
    let environment = options.environment.as_deref().map(environment).transpose()?;
    Ok(Shot {
        size: options.size,
        samples: options.samples,
        environment,
        ..Shot::golden(options.path)
    })
}

/// Reads an environment from an image: a panorama in latitude and longitude, or six faces in a row or in a column.
fn environment(file: &FilePath) -> Result<CubeMap, Box<dyn Error>> {
    let (image, _) = Image::read_exr(file)?;
    let cube = CubeMap::from_image(&image, ENVIRONMENT)?;
    if !cube.size().is_power_of_two() {
        let side = cube.size();
        return Err(format!(
            "`{}`: faces of {side} texels a side have no mip levels; a power of two is needed",
            file.display()
        )
        .into());
    }
    Ok(cube.with_mips())
}
