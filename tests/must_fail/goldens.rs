//! Tests frames and goldens.

use karat::Path;
use karat::image::Precision;
use karat::unstable::golden::Acceptance;
use karat::{Goldens, Image};
use std::path::Path as FilePath;

use crate::processes::planted;

pub(crate) fn golden_fault(folder: &FilePath, environment: &[(&str, &str)]) -> (bool, String) {
    let folder = folder.display().to_string();
    let (output, text) = planted(&["golden", &folder], environment);
    (output.status.success(), text)
}

/// Renders and accepts a frame, and checks that the frame agrees with its golden. Then the test damages the golden in
/// several ways, and the check must fail.
// Lesson 1: golden side
// Lesson 2
// Lesson 16: the golden records its tolerance
#[test]
fn goldens_that_are_missing_shifted_resized_or_corrupt() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let golden = folder.path().join("gradient.exr");
    let pending = folder.path().join("gradient.new.exr");

    let (agrees, text) = golden_fault(folder.path(), &[]);
    assert!(!agrees && text.contains("has no golden"), "{text}");
    assert!(pending.is_file() && !golden.exists(), "only accepting writes a golden");

    let goldens = Goldens::open(folder.path());
    let accept = |because: &str| {
        let pending = goldens.select("gradient").expect("it is pending").frames;
        let because = because.to_owned();
        goldens.accept(
            &pending[0],
            &Acceptance { because, any_adapter: true, ci_may_write: true, ..Default::default() },
        )
    };
    assert!(accept(" ").is_err(), "a reason is needed");
    accept("the first one").expect("accepted");
    assert!(golden.is_file() && folder.path().join("gradient.toml").is_file() && !pending.exists());
    let (agrees, text) = golden_fault(folder.path(), &[]);
    assert!(agrees, "{text}");

    let (original, metadata) = Image::read_exr(&golden).expect("just written");
    let bytes = std::fs::read(&golden).expect("just written");
    let plant = |image: &Image| {
        image.write_exr(&golden, Precision::Half, metadata.as_deref()).expect("written");
        let planted = std::fs::read(&golden).expect("just written");
        let (agrees, text) = golden_fault(folder.path(), &[]);
        assert!(!agrees, "the fault was not seen: {text}");
        assert_eq!(std::fs::read(&golden).expect("there"), planted, "goldens aren't overwritten");
        text
    };

    let mut shifted = original.clone();
    shifted.pixels_mut().rotate_right(1);
    assert!(plant(&shifted).contains("pixels differ"));
    let mut one = original.clone();
    one.pixels_mut()[300][2] *= 1.01;
    assert!(plant(&one).contains("1 of 512 pixels differ by more than rel 1e-3"));
    let mut broken = original.clone();
    broken.pixels_mut()[0][0] = f32::NAN;
    assert!(plant(&broken).contains("the golden itself has 1 pixel with NaN"));
    let resized = Image::new(16, 32, original.pixels().to_vec());
    assert!(
        plant(&resized).contains("the frame's size is 32 x 16, but the golden's size is 16 x 32")
    );

    std::fs::write(&golden, &bytes[..bytes.len() / 2]).expect("written");
    let (agrees, text) = golden_fault(folder.path(), &[]);
    assert!(!agrees && text.contains("isn't a readable OpenEXR image"), "{text}");
    assert_eq!(std::fs::metadata(&golden).expect("there").len(), bytes.len() as u64 / 2);

    // The pending frame was compared with a golden that has changed since.
    plant(&shifted);
    original.write_exr(&golden, Precision::Half, metadata.as_deref()).expect("written");
    assert!(accept("stale").is_err_and(|error| error.to_string().contains("has changed since")));
}

/// A frame with NaN fails its check, and Karat refuses to accept it as a golden.
// Lesson 5
#[test]
fn a_frame_with_nan_is_not_accepted() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder_name = folder.path().display().to_string();
    let (output, text) = planted(&["nan_frame", &folder_name], &[]);
    assert!(!output.status.success() && text.contains("512 pixels with NaN"), "{text}");
    let goldens = Goldens::open(folder.path());
    let pending = goldens.select("gradient").expect("it is pending").frames;
    let acceptance = Acceptance {
        because: "why".to_owned(),
        any_adapter: true,
        ci_may_write: true,
        ..Default::default()
    };
    let error = goldens.accept(&pending[0], &acceptance).expect_err("it has NaN");
    assert!(error.to_string().contains("no frame could agree with such a golden"), "{error}");
}

/// In CI, Karat writes pending frames to another folder, not into the folder of the goldens.
// Lesson 2
// Lesson 42
#[test]
fn ci_leaves_the_folder_of_goldens_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (agrees, text) = golden_fault(folder.path(), &[("CI", "true")]);
    assert!(!agrees && text.contains("has no golden"), "{text}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
    assert!(text.contains("gradient.new.exr"), "the pending file is named: {text}");
    assert!(text.contains(" --from "), "the command finds it there: {text}");
    let (_, text) = golden_fault(folder.path(), &[("CI", "false")]);
    assert!(
        !text.contains(" --from ") && folder.path().join("gradient.new.exr").is_file(),
        "{text}"
    );
}

/// By default, Karat accepts goldens only from lavapipe, which draws the same image on each machine. A golden from
/// another driver could fail on other machines.
// Lesson 17
#[test]
fn accepting_off_the_canonical_rasteriser_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    // Lavapipe is a Vulkan driver. If this machine has no GL, its Vulkan driver isn't lavapipe.
    let path = if karat::unstable::path::adapter(Path::GL).is_ok() { "gl" } else { "vulkan" };
    let (_, text) = golden_fault(folder.path(), &[("KARAT_PATHS", path), ("KARAT_REQUIRE", path)]);
    assert!(text.contains("has no golden"), "{text}");
    let goldens = Goldens::open(folder.path());
    let pending = goldens.select_by("*", |_| true).expect("it is pending").frames;
    let acceptance =
        Acceptance { because: "why".to_owned(), ci_may_write: true, ..Default::default() };
    let error = goldens.accept(&pending[0], &acceptance).expect_err("rendered elsewhere");
    assert!(error.to_string().contains("goldens are made on lavapipe"), "{error}");
}

/// A frame agrees with its golden even if the software rasteriser uses another vector width, as on some other machines.
// Lesson 18: another width
#[test]
fn a_golden_holds_at_another_vector_width() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (_, text) = golden_fault(folder.path(), &[]);
    assert!(text.contains("has no golden"), "{text}");
    let goldens = Goldens::open(folder.path());
    let pending = goldens.select("gradient").expect("it is pending").frames;
    let acceptance = Acceptance {
        because: "why".to_owned(),
        any_adapter: true,
        ci_may_write: true,
        ..Acceptance::default()
    };
    goldens.accept(&pending[0], &acceptance).expect("accepted");
    let open = Path::ALL.into_iter().find_map(|path| karat::unstable::path::adapter(path).ok());
    let narrow = [("LP_NATIVE_VECTOR_WIDTH", "128")];
    let (agrees, text) = golden_fault(folder.path(), &narrow);
    assert!(agrees, "{text}");
    // The adapter's name in a new frame shows that the environment variable has an effect.
    let other = tempfile::tempdir().expect("a temporary folder");
    golden_fault(other.path(), &narrow);
    let pending = Goldens::open(other.path()).select("gradient").expect("it is pending").frames;
    let name = &pending[0].provenance.adapter.name;
    let lavapipe = open.is_some_and(|adapter| adapter.name.contains("llvmpipe"));
    assert!(!lavapipe || name.contains("128 bits"), "{name}");
}

/// The provenance of a golden includes the vector width and the processor, because the results of software rasterisers
/// depend on both.
// Lesson 18: a golden records adapter and processor
#[test]
fn a_golden_says_what_it_was_made_on() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (_, text) = golden_fault(folder.path(), &[]);
    assert!(text.contains("has no golden"), "{text}");
    let goldens = Goldens::open(folder.path());
    let pending = goldens.select("gradient").expect("it is pending").frames;
    let acceptance = Acceptance {
        because: "why".to_owned(),
        any_adapter: true,
        ci_may_write: true,
        ..Default::default()
    };
    goldens.accept(&pending[0], &acceptance).expect("accepted");
    let toml = std::fs::read_to_string(folder.path().join("gradient.toml")).expect("written");
    let adapter = Path::ALL.into_iter().find_map(|path| karat::unstable::path::adapter(path).ok());
    let adapter = adapter.expect("the frame was rendered on the first path that opens");
    assert!(toml.contains(&adapter.name) && toml.contains(&adapter.driver), "{toml}");
    assert!(!adapter.name.contains("llvmpipe") || adapter.name.contains(" bits)"), "{adapter}");
    let processor = toml.lines().find_map(|line| line.strip_prefix("processor = "));
    assert!(processor.is_some_and(|name| name.len() > 2), "{toml}");
}
