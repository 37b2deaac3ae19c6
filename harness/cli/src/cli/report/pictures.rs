//! Small PNG images for each failing frame: the golden, the frame, and the difference.
//!
//! A summary on GitHub can show only images with a URL, and GitHub removes `data:` URLs. So the pictures are in the
//! artefact of the run, and the summary names them.

use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};
use std::time::{Duration, SystemTime};

use super::Names;
use anyhow::Context;
use karat::unstable::golden::Pending;
use karat::unstable::metric::Pair;
use karat::unstable::record::{Record, Subject, Time};
use karat::{Goldens, Image};
use karat_review::Case;

use crate::cli::heatmap::Heatmap;
use crate::cli::project::Project;

/// The largest width in pixels. A wider frame is reduced: the picture has every second pixel, every third, and so on.
const WIDEST: u32 = 480;

/// The part of each picture's file name that says what the picture shows: `actual` in `scene.actual.png`.
const NAMES: [&str; 3] = ["golden", "actual", "flip"];
/// The precision of file times: some file systems store whole seconds.
const COARSE: Duration = Duration::from_secs(1);

/// Removes the pictures that an earlier run made of a frame, so that they can't be mistaken for pictures of this run.
pub(super) fn clear(record: &Record, names: &Names, folder: &Path) -> anyhow::Result<()> {
    let Subject::Frame { golden, folder: goldens, .. } = &record.subject else { return Ok(()) };
    let case = &file_name(golden, goldens, names);
    for name in NAMES {
        let file = picture(folder, case, name);
        match std::fs::remove_file(&file) {
            Err(error)
                if !matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) =>
            {
                return Err(error).with_context(|| format!("can't remove `{}`", file.display()));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Returns the beginning of the file names of a frame's pictures: the frame's name, with the crate if several crates
/// have frames of that name.
fn file_name(golden: &str, goldens: &str, names: &Names) -> String {
    let name = names.frame(golden, goldens).replace("::", "/");
    // A record may come from another machine, and a hostile name may lead out of the folder of pictures.
    let parts = Path::new(&name).components().filter_map(|part| match part {
        Component::Normal(part) => part.to_str(),
        _ => None,
    });
    parts.collect::<Vec<_>>().join("/")
}

fn picture(folder: &Path, case: &str, name: &str) -> PathBuf {
    folder.join(format!("{case}.{name}.png"))
}

/// Returns the pending frame that a check wrote, or the newest one if the check wrote several.
fn pending(
    record: &Record,
    case: &str,
    folders: &[&Goldens],
    goldens: &Goldens,
) -> Option<Pending> {
    let time = record.time.as_ref()?;
    let found = folders.iter().flat_map(|folder| folder.select(case)).flat_map(|of| of.frames);
    let written = |pending: &Pending| pending.path.metadata().ok()?.modified().ok();
    let mut own: Vec<_> = found
        .filter(|pending| pending.is_of(goldens))
        .filter_map(|pending| Some((written(&pending)?, pending)))
        .filter(|(written, _)| is_during(*written, time))
        .collect();
    own.sort_by_key(|(written, _)| *written);
    own.pop().map(|(_, pending)| pending)
}

/// Checks if a file was written during a check. Older and newer files belong to other runs.
fn is_during(written: SystemTime, time: &Time) -> bool {
    let bounds = || {
        let started = humantime::parse_rfc3339(&time.started).ok()?;
        let took = Duration::try_from_secs_f64(time.seconds).ok()?;
        let ended = started.checked_add(took)?.checked_add(COARSE)?;
        Some(started.checked_sub(COARSE)?..=ended)
    };
    bounds().is_some_and(|bounds| bounds.contains(&written))
}

/// Writes the pictures of a frame, and returns the name and the file of each picture. For a record without a time there
/// are no pictures, because the pending frame may belong to another run.
pub(super) fn write(
    record: &Record,
    names: &Names,
    project: &Project,
    folder: &Path,
) -> anyhow::Result<Vec<(&'static str, PathBuf)>> {
    let Subject::Frame { golden: case, folder: goldens, .. } = &record.subject else {
        return Ok(Vec::new());
    };
    if goldens.is_empty() {
        return Ok(Vec::new());
    }
    let file_name = file_name(case, goldens, names);
    let goldens = Goldens::open(Path::new(goldens));
    // With `CI` set, pending frames aren't beside the goldens.
    let waiting = [&Goldens::open(&project.output().join("pending")), &goldens];
    let pending = pending(record, case, &waiting, &goldens);
    let Some(loaded) = pending.and_then(|pending| Case::load(&goldens, &pending).ok()) else {
        return Ok(Vec::new());
    };
    let (golden, actual) = (&loaded.parts[0].golden, &loaded.parts[0].actual);

    let mut written = Vec::new();
    let mut place = |name| {
        let file = picture(folder, &file_name, name);
        written.push((name, file.clone()));
        file
    };
    for (name, image) in [("golden", golden), ("actual", actual)] {
        if let Some(image) = image {
            // The frame gets the exposure of the golden, so that a brighter frame looks brighter.
            let stops = golden.as_ref().map_or(0.0, |golden| (image.key() / golden.key()).log2());
            let small = small(image);
            let stops = stops - (image.key() / small.key()).log2();
            small.write_png_exposed(&place(name), if stops.is_finite() { stops } else { 0.0 })?;
        }
    }
    if let (Some(golden), Some(actual)) = (golden, actual) {
        let mask = loaded.mask();
        let pair = match &mask {
            Some(mask) => Pair::masked(golden, actual, mask),
            None => Pair::new(golden, actual),
        };
        if let Some(map) = pair.ok().and_then(|pair| Heatmap::flip(&pair).ok()) {
            map.write(&place("flip"))?;
        }
    }
    Ok(written)
}

fn small(image: &Image) -> Image {
    let step = image.width().div_ceil(WIDEST).max(1);
    let (width, height) = (image.width().div_ceil(step), image.height().div_ceil(step));
    let at = |x: u32, y: u32| image.pixels()[(y * step * image.width() + x * step) as usize];
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| at(x, y));
    Image::new(width, height, pixels.collect())
}

#[cfg(test)]
mod tests {
    use super::super::tables::tests::record;
    use super::*;
    use karat::unstable::record::Verdict;

    #[test]
    fn pictures_stay_in_their_folder() {
        let frame = |golden: &str, folder: &str| {
            let (golden, folder, location) = (golden.into(), folder.into(), String::new());
            let mut frame = record(Verdict::Fail, 1, None);
            frame.subject = Subject::Frame { golden, folder, location };
            frame.cargo_package = "a".to_owned();
            frame
        };
        let place = tempfile::tempdir().expect("a folder");
        let pictures = place.path().join("target/karat/report");
        std::fs::create_dir_all(&pictures).expect("a folder");
        // The first name is in two folders of a crate, so the file name has the folder. The second name leads out of
        // the folder.
        let out = format!("{}/none/../../golden", place.path().display());
        let (one, other) = (frame("dusk", "../../../w/golden"), frame("dusk", &out));
        let records = [one, other, frame("../../../dusk", ""), frame("/dusk", "")];
        let names = Names::of(&records);
        for record in &records {
            let Subject::Frame { golden, folder, .. } = &record.subject else { continue };
            let file = picture(&pictures, &file_name(golden, folder, &names), "actual");
            let below = file.strip_prefix(&pictures).expect("it is below");
            let is_normal = |part: Component<'_>| matches!(part, Component::Normal(_));
            assert!(below.components().all(is_normal), "{}", file.display());
        }
        let kept = place.path().join("dusk.actual.png");
        std::fs::write(&kept, "").expect("a file");
        for record in &records {
            clear(record, &names, &pictures).expect("nothing is in the way");
        }
        assert!(kept.is_file(), "it is none of these pictures");
    }
}
