//! Runs commands of git.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, bail, ensure};
use karat::unstable::output::visible;
use karat::unstable::process;

/// Runs git in a folder, and returns its output. In this output, file names have no quotes, and are relative to the
/// repository's root, whatever the user has configured.
pub(super) fn git(folder: &Path, arguments: &[&str]) -> anyhow::Result<Vec<u8>> {
    let mut command = Command::new("git");
    command.current_dir(folder);
    command.args(["-c", "core.quotePath=false", "-c", "diff.relative=false"]).args(arguments);
    let output = process::output(&mut command, process::LOOK_UP, u64::MAX);
    let output = output.context("can't run git")?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        match said.trim() {
            "" => bail!("`git {}` fails", arguments[0]),
            said => bail!("{}", visible(said)),
        }
    }
    Ok(output.stdout)
}

/// Returns, for each file of a folder, the lines that changed since the current branch left `revision`. All lines of an
/// untracked file count as changed.
pub(super) fn lines_since(
    revision: &str,
    folder: &Path,
) -> anyhow::Result<BTreeMap<PathBuf, Vec<RangeInclusive<usize>>>> {
    let around = if folder.is_file() { folder.parent().unwrap_or(folder) } else { folder };
    let git = |arguments: &[&str]| -> anyhow::Result<String> {
        Ok(String::from_utf8_lossy(&git(around, arguments)?).into_owned())
    };
    ensure!(!revision.starts_with('-'), "`{revision}` isn't a revision");
    let root = PathBuf::from(git(&["rev-parse", "--show-toplevel"])?.trim_end_matches('\n'));
    let mut all: BTreeMap<PathBuf, Vec<RangeInclusive<usize>>> = BTreeMap::new();
    let place = |name: &str| {
        let path = root.join(name);
        path.canonicalize().with_context(|| format!("git names `{}`", path.display()))
    };
    let diff = git(&[
        "diff",
        "--merge-base",
        "--no-color",
        "--no-ext-diff",
        "--unified=0",
        "--diff-filter=d",
        "--src-prefix=a/",
        "--dst-prefix=b/",
        revision,
        "--",
        ".",
    ])?;
    let mut file = None;
    for line in diff.lines() {
        if let Some(name) = line.strip_prefix("+++ ") {
            // If a name has blanks, git writes a tab after the name.
            let name = name.trim_end_matches('\t');
            ensure!(!name.starts_with('"'), "Karat can't read a file name from git: {name}");
            file = name.strip_prefix("b/").map(place).transpose()?;
        } else if let (Some(file), Some(hunk)) = (&file, line.strip_prefix("@@ ")) {
            let after = hunk.split(' ').find_map(|part| part.strip_prefix('+')).unwrap_or_default();
            let (start, count) = after.split_once(',').unwrap_or((after, "1"));
            let (start, count): (usize, usize) = (start.parse()?, count.parse()?);
            if count > 0 {
                all.entry(file.clone()).or_default().push(start..=start + count - 1);
            }
        }
    }
    let others = git(&["ls-files", "-z", "--others", "--exclude-standard", "--full-name", "."])?;
    for name in others.split('\0').filter(|name| !name.is_empty()) {
        all.entry(place(name)?).or_default().push(1..=usize::MAX);
    }
    Ok(all)
}

/// Copies shaders of a revision into `folder`: the modules and `karat.toml` files that are below `root` at this
/// revision. Returns the path that corresponds to `root` in the copy.
pub(super) fn shaders_at(revision: &str, root: &Path, folder: &Path) -> anyhow::Result<PathBuf> {
    let root = root.canonicalize().with_context(|| format!("`{}`", root.display()))?;
    let (base, file) = match root.is_file() {
        true => (root.parent().unwrap_or(&root).to_owned(), root.file_name()),
        false => (root.clone(), None),
    };
    let git = |arguments: &[&str]| git(&base, arguments);
    let tree = format!("{revision}^{{commit}}");
    git(&["rev-parse", "--verify", "--quiet", "--end-of-options", &tree]).with_context(|| {
        format!("`{revision}` is neither a folder nor a revision of git in `{}`", base.display())
    })?;
    let list = git(&["ls-tree", "-r", "-z", "--name-only", revision, "--", "."])?;
    let is_shader = |name: &str| {
        let end = Path::new(name).extension().unwrap_or_default();
        end == "wgsl" || end == "wesl" || Path::new(name).ends_with("karat.toml")
    };
    let names = list.split(|byte| *byte == 0).filter_map(|name| std::str::from_utf8(name).ok());
    let mut count = 0;
    for name in names.filter(|name| is_shader(name)) {
        let bytes = git(&["show", &format!("{revision}:./{name}")])?;
        let to = folder.join(name);
        std::fs::create_dir_all(to.parent().unwrap_or(folder))
            .context("can't make a temporary folder")?;
        std::fs::write(&to, bytes).with_context(|| format!("can't write `{}`", to.display()))?;
        count += 1;
    }
    ensure!(count > 0, "there are no shaders in `{}` at revision `{revision}`", base.display());
    Ok(file.map_or_else(|| folder.to_owned(), |file| folder.join(file)))
}
