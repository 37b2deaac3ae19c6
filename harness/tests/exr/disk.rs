//! Full disks, read-only folders, and several writers of the same file.

use std::path::Path;

use karat::Image;
use karat::image::Precision;

/// An image of noise, which needs some 60 KB in a file with any compression.
fn noise(seed: u32) -> Image {
    let mut state = seed;
    let mut value = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f32::from_bits(0x3f80_0000 | state >> 9)
    };
    let pixels = (0..64 * 64).map(|_| [value(), value(), value(), 1.0]);
    Image::new(64, 64, pixels.collect())
}

fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let name = |entry: std::io::Result<std::fs::DirEntry>| entry.expect("readable").file_name();
    let mut names: Vec<_> = entries.map(|e| name(e).to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The environment variable with the folder into which the child process of `a_full_disk_leaves_the_old_file` writes.
const PLACE: &str = "KARAT_TEST_FULL_DISK";

/// The child process of `a_full_disk_leaves_the_old_file` runs this test. In this process, no file can grow beyond
/// 16 of the shell's blocks, which is 8 KB or 16 KB.
#[cfg(target_os = "linux")]
#[test]
fn child_on_a_full_disk() {
    let Some(folder) = std::env::var_os(PLACE) else { return };
    let golden = Path::new(&folder).join("golden.exr");
    let error = noise(2).write_exr(&golden, Precision::Float, None).expect_err("a full disk");
    // The message comes from the system: error 27 is EFBIG.
    assert!(error.to_string().ends_with("(os error 27)"), "{error}");
    let preview = Path::new(&folder).join("golden.png");
    assert!(noise(2).write_png(&preview).is_err() && !preview.exists());
    let new = Path::new(&folder).join("new.exr");
    assert!(noise(2).write_exr(&new, Precision::Float, None).is_err() && !new.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_the_old_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let golden = folder.path().join("golden.exr");
    noise(1).write_exr(&golden, Precision::Float, None).expect("written");
    let before = std::fs::read(&golden).expect("readable");
    assert!(before.len() > 32 << 10);
    let binary = std::env::current_exe().expect("this binary");
    let script = "trap '' XFSZ; ulimit -f 16; exec \"$0\" --exact disk::child_on_a_full_disk";
    let child = std::process::Command::new("sh")
        .args(["-c", script])
        .arg(binary)
        .env(PLACE, folder.path())
        .output()
        .expect("sh runs");
    let text = String::from_utf8_lossy(&child.stdout);
    assert!(child.status.success() && text.contains("1 passed"), "{text}");
    assert!(std::fs::read(&golden).expect("readable") == before, "the golden has changed");
    assert_eq!(files(folder.path()), ["golden.exr"]);
}

#[test]
fn places_that_cannot_be_written_stay_as_they_are() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("file"), "x").expect("written");
    std::fs::create_dir(folder.path().join("folder.exr")).expect("created");
    for place in ["file/golden.exr", "folder.exr"] {
        let path = folder.path().join(place);
        let error = noise(1).write_exr(&path, Precision::Half, None).expect_err(place);
        assert!(error.to_string().contains(place), "{error}");
    }
    let error = noise(1).write_exr(Path::new("/"), Precision::Half, None);
    assert!(error.is_err());
    assert_eq!(files(folder.path()), ["file", "folder.exr"]);
    assert!(files(&folder.path().join("folder.exr")).is_empty());
}

/// Karat can't write into a read-only folder. Root may write anywhere, so for root the test proves nothing.
#[cfg(unix)]
#[test]
fn a_folder_without_permission_is_an_error() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let locked = folder.path().join("locked");
    std::fs::create_dir(&locked).expect("created");
    let permit = |mode| {
        let permissions = std::fs::Permissions::from_mode(mode);
        std::fs::set_permissions(&locked, permissions).expect("ours");
    };
    permit(0o555);
    let written = noise(1).write_exr(&locked.join("a.exr"), Precision::Half, None);
    permit(0o755);
    let expected: &[&str] = if written.is_ok() { &["a.exr"] } else { &[] };
    assert_eq!(files(&locked), expected);
}

#[test]
fn writers_of_the_same_file_do_not_mix() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("golden.exr");
    let images = [noise(1), noise(2), noise(3)];
    images[0].write_exr(&path, Precision::Float, None).expect("written");
    std::thread::scope(|scope| {
        let writers = images.each_ref().map(|image| {
            scope.spawn(|| {
                for _ in 0..10 {
                    image.write_exr(&path, Precision::Float, None).expect("written");
                }
            })
        });
        while !writers.iter().all(std::thread::ScopedJoinHandle::is_finished) {
            let (read, _) = Image::read_exr(&path).expect("whole at any time");
            assert!(images.contains(&read), "a mixture");
        }
    });
    assert_eq!(files(folder.path()), ["golden.exr"]);
}
