//! Opens paths, each at most once in a process.

use std::collections::BTreeMap;
use std::sync::{Mutex, OnceLock};

use super::{Adapter, Api, Device, Path, PathError, Process, cpu};
use crate::{panics, settings};

#[derive(Clone, Copy, Debug)]
pub(crate) enum Opened {
    Device(&'static Device),
    Process(&'static Process),
    /// Karat's engine. The path's route is the engine's arithmetic, as in `cpu:fma`.
    Cpu(Path),
}

impl Opened {
    pub(crate) fn path(self) -> Path {
        match self {
            Self::Device(device) => device.path(),
            Self::Process(process) => process.path(),
            Self::Cpu(path) => path,
        }
    }

    pub(crate) fn adapter(self) -> Adapter {
        match self {
            Self::Device(device) => device.adapter().clone(),
            Self::Process(process) => process.adapter(),
            Self::Cpu(path) => cpu::adapter(path),
        }
    }

    pub(crate) fn device(self) -> Option<&'static Device> {
        match self {
            Self::Device(device) => Some(device),
            _ => None,
        }
    }
}

/// Opens a path. If this process has already opened the path, returns the same device or program again. Several threads
/// may open different paths at the same time.
pub(crate) fn open(path: Path) -> Result<Opened, PathError> {
    type Once = OnceLock<Result<Opened, PathError>>;
    static OPENED: Mutex<BTreeMap<Path, &'static Once>> = Mutex::new(BTreeMap::new());
    settings::current()?;
    if path.api() == Api::Cpu
        && path.driver().is_none()
        && (path == Path::CPU || path.via().is_arithmetic())
    {
        return Ok(Opened::Cpu(path));
    }
    if path.via().is_arithmetic() {
        let message = format!(
            "Karat can't change a driver's arithmetic. Use the path `cpu:{}` of Karat's engine",
            path.via()
        );
        return Err(PathError::Route { path, message });
    }
    let once: &'static Once = {
        let mut opened = OPENED.lock().expect("no thread panics while it holds the lock");
        opened.entry(path).or_insert_with(|| Box::leak(Box::default()))
    };
    // A path stays open until the process ends.
    let opened = once.get_or_init(|| match path.api() {
        Api::Process => Ok(Opened::Process(Box::leak(Box::new(Process::open(path)?)))),
        _ => {
            let subject = "its opening".to_owned();
            let device = panics::caught(|| Device::open(path))
                .unwrap_or_else(|panicked| Err(PathError::Panicked { path, subject, panicked }));
            Ok(Opened::Device(Box::leak(Box::new(device?))))
        }
    });
    // The user may have repaired the program, so the next attempt starts it again.
    if opened.is_err() && path.api() == Api::Process {
        OPENED.lock().expect("no thread panics while it holds the lock").remove(&path);
    }
    opened.clone()
}

/// The device of a path. `None` for the path `cpu` and for programs that run jobs, because this process opens no device
/// for them.
///
/// # Errors
/// Returns an error if the path can't be opened.
pub fn device(path: Path) -> Result<Option<&'static Device>, PathError> {
    open(path).map(Opened::device)
}
