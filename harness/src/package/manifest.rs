//! `karat.toml` beside the modules of a folder: features, and what expands modules.

use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde::Deserialize;

use super::feature::{Feature, Features};
use super::{Origin, Package, PackageError};
use crate::diagnostic::{SourceFile, shown};
use crate::settings;

/// The file's name.
pub(super) const NAME: &str = "karat.toml";

/// What it says.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    /// Features that are set, unless a test or the command line sets them otherwise.
    #[serde(default)]
    features: BTreeMap<String, toml::Value>,
    /// A program with its arguments that prints a module as WGSL. The module's file is its last
    /// argument, and it runs in the folder of the modules.
    preprocess: Option<Vec<String>>,
}

/// What a program may print of one module: far more than any has.
const MOST_BYTES: u64 = 16 << 20;

/// How often a program is looked after.
const POLL: Duration = Duration::from_millis(10);

impl Manifest {
    /// That of a package; an empty one if there is no file.
    pub(super) fn of(package: &Package) -> Result<Self, PackageError> {
        let file = match &package.origin {
            Origin::Folder { .. } => package.root().join(NAME),
            Origin::File { path, .. } => path.with_file_name(NAME),
            _ => return Ok(Self::default()),
        };
        let error = |reason: String| PackageError::Manifest { file: shown(&file), reason };
        let text = match std::fs::read_to_string(&file) {
            Ok(text) => text,
            Err(none) if none.kind() == std::io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(other) => return Err(error(other.to_string())),
        };
        let manifest: Self = toml::from_str(&text)
            .map_err(|reason| error(reason.to_string().trim_end().to_owned()))?;
        let wrong = |(_, value): &(&String, &toml::Value)| feature(value).is_none();
        if let Some((name, _)) = manifest.features.iter().find(wrong) {
            return Err(error(format!("feature `{name}` is a whole number, `true` or `false`")));
        }
        if manifest.preprocess.as_ref().is_some_and(Vec::is_empty) {
            return Err(error("`preprocess` names no program".to_owned()));
        }
        Ok(manifest)
    }

    pub(super) fn features(&self) -> Features {
        let known = self.features.iter();
        known.filter_map(|(name, value)| Some((name.clone(), feature(value)?))).collect()
    }

    /// A module as it is, or as the package's program prints it; once in a process for the same text.
    pub(super) fn expanded(
        &self,
        root: &Path,
        path: &Path,
        source: SourceFile,
    ) -> Result<SourceFile, PackageError> {
        type Known = HashMap<(PathBuf, blake3::Hash), String>;
        static KNOWN: LazyLock<Mutex<Known>> = LazyLock::new(Mutex::default);
        let Some([program, arguments @ ..]) = self.preprocess.as_deref() else { return Ok(source) };
        let lock = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (path.to_owned(), blake3::hash(source.text.as_bytes()));
        // In brackets, as texts are that are in no file.
        let name = format!("<{}, as `{program}` prints it>", source.name);
        if let Some(text) = lock().get(&key).cloned() {
            return Ok(SourceFile { name, text });
        }
        let error = |reason: String| {
            let (file, program) = (shown(path), program.clone());
            PackageError::Preprocess { file, program, reason }
        };
        let whole = |path: &Path| path.canonicalize().map_err(|reason| error(reason.to_string()));
        let (root, file) = (whole(root)?, whole(path)?);
        let mut command = Command::new(program);
        command.args(arguments).arg(&file).current_dir(root);
        let text = String::from_utf8(printed(command).map_err(error)?);
        let text = text.map_err(|_| error("what it prints isn't UTF-8".to_owned()))?;
        if text.trim().is_empty() {
            return Err(error("it prints nothing".to_owned()));
        }
        lock().insert(key, text.clone());
        Ok(SourceFile { name, text })
    }
}

fn feature(value: &toml::Value) -> Option<Feature> {
    match value {
        toml::Value::Boolean(on) => Some(Feature::Flag(*on)),
        toml::Value::Integer(value) => Some(Feature::Number(*value)),
        _ => None,
    }
}

/// What a program prints, unless it fails, prints too much or doesn't end: then why.
fn printed(mut command: Command) -> Result<Vec<u8>, String> {
    let deadline = settings::current().map_err(|error| error.to_string())?.deadline;
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let shown = format!("{command:?}");
    let mut child =
        command.spawn().map_err(|reason| format!("it doesn't run: {reason} ({shown})"))?;
    let (out, err) = (child.stdout.take(), child.stderr.take());
    let read = |stream: Option<Box<dyn Read + Send>>| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            // One byte more tells that there is too much; then nobody reads on, and the program ends.
            let whole = stream.map(|stream| stream.take(MOST_BYTES + 1).read_to_end(&mut bytes));
            whole.transpose().map(|_| bytes)
        })
    };
    let boxed = |stream: Box<dyn Read + Send>| read(Some(stream));
    let (out, err) = (out.map(|out| boxed(Box::new(out))), err.map(|err| boxed(Box::new(err))));
    let began = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if began.elapsed() < deadline => std::thread::sleep(POLL),
            Ok(None) => {
                drop(child.kill());
                drop(child.wait());
                let seconds = deadline.as_secs_f64();
                return Err(format!("it didn't end within {seconds} s (KARAT_DEADLINE): {shown}"));
            }
            Err(error) => return Err(error.to_string()),
        }
    };
    let bytes = |reader: Option<std::thread::JoinHandle<std::io::Result<Vec<u8>>>>| {
        reader.and_then(|reader| reader.join().ok()?.ok()).unwrap_or_default()
    };
    let (out, err) = (bytes(out), bytes(err));
    if out.len() as u64 > MOST_BYTES {
        return Err(format!("it prints more than {} MiB: {shown}", MOST_BYTES >> 20));
    }
    if !status.success() {
        let said = String::from_utf8_lossy(&err);
        return Err(format!("{status}: {shown}\n{}", said.trim_end()).trim_end().to_owned());
    }
    Ok(out)
}
