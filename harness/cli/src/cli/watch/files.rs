//! Which files changed: editors write in several steps, and by renaming, so that events of one save come in
//! a burst.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use anyhow::Context;
use notify::{Event as Changed, EventKind, RecommendedWatcher, RecursiveMode, Watcher};
use same_file::Handle;

use super::Event;

/// A burst is over when nothing comes for this long. One that goes on later runs the tests once more.
const QUIET: Duration = Duration::from_millis(1);

/// A burst that doesn't end is told all the same.
const LONGEST: Duration = Duration::from_millis(100);

/// How often it is looked whether the folder is still the same one.
const MISSING: Duration = Duration::from_millis(200);

/// Files whose changes concern tests.
const ENDINGS: [&str; 14] = [
    "wgsl", "wesl", "toml", "csv", "exr", "png", "rs", "lock", "json", "ron", "npy", "hdr", "glsl",
    "txt",
];

/// Watches while it lives.
pub(super) struct Watching {
    _ends: Sender<()>,
}

/// Tells of each burst of changes below a folder, or of a file. If the folder goes, or another one takes its
/// place, that is told, and what is there is watched.
pub(super) fn watch(folder: &Path, sender: Sender<Event>) -> anyhow::Result<Watching> {
    let root = folder.canonicalize().with_context(|| format!("`{}`", folder.display()))?;
    // Editors replace files: a file is watched by its folder.
    let above =
        if root.is_file() { root.parent().unwrap_or(&root).to_owned() } else { root.clone() };
    let (raw, changes) = channel();
    let watcher = started(&above, &raw)?;
    let (ends, ended) = channel::<()>();
    std::thread::spawn(move || follow(watcher, &above, &raw, &changes, &ended, &sender));
    Ok(Watching { _ends: ends })
}

type Raw = Sender<notify::Result<Changed>>;

fn started(folder: &Path, raw: &Raw) -> anyhow::Result<RecommendedWatcher> {
    let mut watcher = notify::recommended_watcher(raw.clone()).context("files can't be watched")?;
    let name = || format!("`{}` can't be watched", folder.display());
    watcher.watch(folder, RecursiveMode::Recursive).with_context(name)?;
    Ok(watcher)
}

fn follow(
    watcher: RecommendedWatcher,
    folder: &Path,
    raw: &Raw,
    changes: &Receiver<notify::Result<Changed>>,
    ended: &Receiver<()>,
    sender: &Sender<Event>,
) {
    let mut watcher = Some(watcher);
    let mut there = Handle::from_path(folder).ok();
    while !matches!(ended.try_recv(), Err(std::sync::mpsc::TryRecvError::Disconnected)) {
        let mut files = BTreeSet::new();
        match changes.recv_timeout(MISSING) {
            Ok(change) => add(&mut files, change),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        let began = Instant::now();
        while began.elapsed() < LONGEST
            && let Ok(change) = changes.recv_timeout(QUIET)
        {
            add(&mut files, change);
        }
        let now = Handle::from_path(folder).ok().filter(|_| folder.is_dir());
        if now != there {
            files.insert(folder.to_owned());
            // The watch of a folder that is gone sees nothing of the one that has its place.
            watcher = now.as_ref().and_then(|_| started(folder, raw).ok());
            there = now.filter(|_| watcher.is_some());
        }
        if !files.is_empty() && sender.send(Event::Files(files.into_iter().collect())).is_err() {
            return;
        }
    }
    drop(watcher);
}

fn add(files: &mut BTreeSet<PathBuf>, change: notify::Result<Changed>) {
    let Ok(Changed { kind, paths, .. }) = change else { return };
    if matches!(kind, EventKind::Access(_)) {
        return;
    }
    files.extend(paths.into_iter().filter(|path| {
        let is_ours =
            |part: &std::ffi::OsStr| part == ".karat" || part == "target" || part == ".git";
        let ending = path.extension().unwrap_or_default();
        let pending = path.to_string_lossy().contains(".new.");
        ENDINGS.iter().any(|known| ending == *known) && !pending && !path.iter().any(is_ours)
    }));
}
