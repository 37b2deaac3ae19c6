//! Watches files. Editors write in several steps and rename files, so one save causes a burst of events.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use anyhow::Context;
use notify::event::{AccessKind, AccessMode, ModifyKind, RemoveKind, RenameMode};
use notify::{Event as Changed, EventKind, RecommendedWatcher, RecursiveMode, Watcher};
use same_file::Handle;

/// The time without events that ends a burst. If more events of the same save follow later, the tests run once more.
const QUIET: Duration = Duration::from_millis(1);

/// The time without events that ends a burst after a file was saved completely. Other files may follow: a checkout
/// writes a file in about 0.1 ms.
const SAVED: Duration = Duration::from_micros(200);

/// The longest duration of a burst. After this time, Karat reports the files that have changed so far.
const LONGEST: Duration = Duration::from_millis(100);

/// The interval at which Karat checks that the watched folder wasn't removed or replaced.
const MISSING: Duration = Duration::from_millis(200);

/// Keeps the watch of a file or folder active until this value is dropped.
pub(in crate::cli) struct Watching {
    _ends: Sender<()>,
}

/// Watches a file or folder, and calls `tell` with the changed paths of each burst, until `tell` returns `false`. The
/// removal or replacement of the folder is a change, too. After a replacement, Karat watches the new folder.
pub(in crate::cli) fn watch(
    folder: &Path,
    tell: impl Fn(Vec<PathBuf>) -> bool + Send + 'static,
) -> anyhow::Result<Watching> {
    let root = folder.canonicalize().with_context(|| format!("`{}`", folder.display()))?;
    // Editors replace files, so Karat watches the folder of a file.
    let above =
        if root.is_file() { root.parent().unwrap_or(&root).to_owned() } else { root.clone() };
    let (raw, changes) = channel();
    let watcher = started(&above, &raw)?;
    let (ends, ended) = channel::<()>();
    std::thread::spawn(move || follow(watcher, &above, &raw, &changes, &ended, &tell));
    Ok(Watching { _ends: ends })
}

type Raw = Sender<notify::Result<Changed>>;

fn started(folder: &Path, raw: &Raw) -> anyhow::Result<RecommendedWatcher> {
    let raw = raw.clone();
    let changes = move |change: notify::Result<Changed>| {
        // The tests read files, and cause these events.
        let only_reads = |kind: &EventKind| matches!(kind, EventKind::Access(_)) && !is_whole(kind);
        if !change.as_ref().is_ok_and(|change| only_reads(&change.kind)) {
            let _ = raw.send(change);
        }
    };
    let mut watcher = notify::recommended_watcher(changes).context("can't watch files")?;
    let name = || format!("can't watch `{}`", folder.display());
    watcher.watch(folder, RecursiveMode::Recursive).with_context(name)?;
    Ok(watcher)
}

fn follow(
    watcher: RecommendedWatcher,
    folder: &Path,
    raw: &Raw,
    changes: &Receiver<notify::Result<Changed>>,
    ended: &Receiver<()>,
    tell: &dyn Fn(Vec<PathBuf>) -> bool,
) {
    let mut watcher = Some(watcher);
    let mut look_again: Option<(Instant, BTreeSet<PathBuf>)> = None;
    let mut there = Handle::from_path(folder).ok();
    while !matches!(ended.try_recv(), Err(std::sync::mpsc::TryRecvError::Disconnected)) {
        let mut seen = Seen::default();
        let mut take = |change: notify::Result<Changed>| {
            let is_saved = change.as_ref().is_ok_and(|change| is_whole(&change.kind));
            seen.add(folder, change);
            if is_saved { SAVED } else { QUIET }
        };
        let mut wait = match changes.recv_timeout(MISSING) {
            Ok(change) => take(change),
            Err(RecvTimeoutError::Timeout) => QUIET,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let began = Instant::now();
        while began.elapsed() < LONGEST
            && let Ok(change) = changes.recv_timeout(wait)
        {
            wait = take(change);
        }
        let Seen { mut files, folders, .. } = seen;
        // Files may have been written into a new folder before the watch began.
        if look_again.as_ref().is_some_and(|(at, _)| at.elapsed() >= MISSING)
            && let Some((_, seen)) = look_again.take()
        {
            files.extend(seen);
        }
        if !folders.is_empty() {
            look_again = Some((Instant::now(), files.clone()));
        }
        let now = Handle::from_path(folder).ok().filter(|_| folder.is_dir());
        if now != there {
            files.insert(folder.to_owned());
            // The watch of a removed folder doesn't see a new folder in its place.
            watcher = now.as_ref().and_then(|_| started(folder, raw).ok());
            there = now.filter(|_| watcher.is_some());
        }
        if !files.is_empty() && !tell(files.into_iter().collect()) {
            return;
        }
    }
    drop(watcher);
}

/// Checks if a file is complete after this event: a program closed the file after writing, or gave the file its final
/// name.
fn is_whole(kind: &EventKind) -> bool {
    let closed = EventKind::Access(AccessKind::Close(AccessMode::Write));
    *kind == closed || *kind == EventKind::Modify(ModifyKind::Name(RenameMode::To))
}

/// The files and folders of a burst of changes.
#[derive(Default)]
struct Seen {
    files: BTreeSet<PathBuf>,
    created: BTreeSet<PathBuf>,
    /// The new and removed folders. Files in these folders may have changed without an event for each file.
    folders: BTreeSet<PathBuf>,
}

impl Seen {
    fn add(&mut self, root: &Path, change: notify::Result<Changed>) {
        let Ok(Changed { kind, paths, .. }) = change else { return };
        // The system reports both names of a renaming once more, together.
        if kind == EventKind::Modify(ModifyKind::Name(RenameMode::Both)) {
            if let [from, to] = &*paths
                && to.is_file()
            {
                self.folders.remove(from);
                // Editors write a temporary file, and rename it.
                if self.created.remove(from) {
                    self.files.remove(from);
                }
            }
            return;
        }
        for path in paths.into_iter().filter(|path| !is_ours(path, root)) {
            // A renamed path may have been a folder.
            let gone = match kind {
                EventKind::Remove(kind) => kind != RemoveKind::File,
                EventKind::Modify(ModifyKind::Name(_)) => true,
                _ => false,
            };
            let no_ending = path.extension().is_none();
            let folder = path.is_dir() || (gone && no_ending && !path.exists());
            let created = !matches!(kind, EventKind::Modify(ModifyKind::Metadata(_)));
            if folder && created {
                self.folders.insert(path.clone());
            }
            if matches!(kind, EventKind::Create(_)) {
                self.created.insert(path.clone());
            }
            if (!folder || created) && !is_output(&path) {
                self.files.insert(path);
            }
        }
    }
}

/// Checks if this process writes its standard output or standard error into this file.
fn is_output(path: &Path) -> bool {
    static OUTPUTS: OnceLock<Vec<Handle>> = OnceLock::new();
    let outputs = OUTPUTS
        .get_or_init(|| [Handle::stdout(), Handle::stderr()].into_iter().flatten().collect());
    // Opening a pipe to identify it would wait for the writer of the pipe.
    let own = path.is_file().then(|| Handle::from_path(path).ok()).flatten();
    own.is_some_and(|own| outputs.contains(&own))
}

/// Checks if a path below the root is build output, a pending frame, or a file of a tool, such as git or an editor.
fn is_ours(path: &Path, root: &Path) -> bool {
    let below = path.strip_prefix(root).unwrap_or(path);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    // The names of an editor's lock, `.#brdf.wgsl`, of its copies, `brdf.wgsl~` and `#brdf.wgsl#`, and of files of the
    // system.
    if name.starts_with(['.', '#']) || name.ends_with('~') {
        return true;
    }
    let mut at = root.to_owned();
    let kept = below.iter().any(|part| {
        // A folder `target` without a Cargo project may contain modules.
        let built = part == "target" && at.join("Cargo.toml").is_file();
        at.push(part);
        built || at.join("CACHEDIR.TAG").is_file() || part == ".karat" || part == ".git"
    });
    // Before it saves, Vim writes and removes a file that is named after a number.
    kept || name.contains(".new.") || name.bytes().all(|byte| byte.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests read the watched files. If reading a file counted as a change, each run of the tests would start another
    /// run.
    #[test]
    fn reading_a_file_is_not_a_change() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("a.wgsl");
        std::fs::write(&file, "").expect("a file");
        let (raw, changes) = channel();
        let _watcher = started(folder.path(), &raw).expect("it is watched");
        let quiet = || changes.recv_timeout(Duration::from_millis(300)).is_err();
        std::fs::read(&file).expect("it is there");
        Handle::from_path(folder.path()).expect("it is there");
        assert!(quiet());
        std::fs::write(&file, "fn f() {}").expect("a file");
        assert!(!quiet(), "a change is told");
    }

    /// If an editor writes a temporary file and renames it, the watch reports only the renamed file.
    #[test]
    fn a_save_by_rename_is_one_change() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path().canonicalize().expect("a folder");
        let (told, changes) = channel();
        let _watching = watch(&root, move |files| told.send(files).is_ok()).expect("it is watched");
        let file = root.join("a.wgsl");
        for text in ["fn f() {}", "fn g() {}"] {
            std::fs::write(root.join("sedufvWVo"), text).expect("written");
            std::fs::rename(root.join("sedufvWVo"), &file).expect("renamed");
            let first = changes.recv_timeout(Duration::from_secs(20)).expect("it is told");
            assert_eq!(first, std::slice::from_ref(&file));
            let again = changes.recv_timeout(3 * MISSING);
            assert!(again.is_err(), "{again:?}");
        }
    }

    // Lesson 101
    // Lesson 192
    #[test]
    fn only_our_files_below_the_root_are_ignored() {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path().join("target").join("x.new.1");
        std::fs::create_dir_all(root.join("cargo")).expect("a folder");
        std::fs::write(root.join("cargo").join("Cargo.toml"), "").expect("a file");
        std::fs::create_dir(root.join("built")).expect("a folder");
        std::fs::write(root.join("built").join("CACHEDIR.TAG"), "").expect("a file");
        for (path, ours) in [
            ("lib.wgsl", false),
            ("target/lib.wgsl", false),
            ("cargo/target/lib.wgsl", true),
            (".karat/run/a.json", true),
            (".git/index.toml", true),
            ("golden/a.new.exr", true),
            ("golden/a.exr", false),
            ("4913", true),
            (".#lib.wgsl", true),
            ("lib2", false),
            ("rows", false),
            ("rows.dat", false),
            ("lib.wgsl~", true),
            ("#lib.wgsl#", true),
            ("built/debug/deps/a", true),
        ] {
            assert_eq!(is_ours(&root.join(path), &root), ours, "{path}");
        }
    }
}
