//! Measures the accuracy of an adapter's builtin functions once, and stores the result in cargo's home folder.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path as FilePath;
use std::sync::{Arc, Mutex, PoisonError};

use super::{Caller, Executor};
use crate::interpret::Accuracy;
use crate::package::Package;
use crate::probe::{ProbeError, Probed};
use crate::{image, settings};

/// The version of the stored file. If this number changes, Karat measures again. Increase this number if you change the
/// measured arguments or the format of the file.
const EDITION: u32 = 3;

/// Returns the accuracy of an executor's builtin functions. If `kept` is `true`, Karat reads the accuracy from a
/// file, or measures the accuracy and stores it in that file for later processes.
pub(crate) fn measured(executor: &dyn Executor, kept: bool) -> Result<Arc<Accuracy>, ProbeError> {
    static KNOWN: Mutex<BTreeMap<String, Arc<Accuracy>>> = Mutex::new(BTreeMap::new());
    let key = super::adapter(executor).to_string();
    // While one test measures, tests that run in parallel wait for the result.
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(accuracy) = known.get(&key).filter(|_| kept) {
        return Ok(Arc::clone(accuracy));
    }
    let file = kept.then(|| settings::kept(&format!("accuracy/{}", name(&key)))).flatten();
    let accuracy = match file.as_deref().and_then(read) {
        Some(accuracy) => accuracy,
        None => {
            let accuracy = measure(executor)?;
            // If Karat can't write the file, the next process measures again.
            if let Some(file) = file {
                let bytes = bytemuck::cast_slice(&accuracy.words()).to_vec();
                drop(image::write_whole(&file, &bytes));
            }
            accuracy
        }
    };
    let accuracy = Arc::new(accuracy);
    if kept {
        known.insert(key, Arc::clone(&accuracy));
    }
    Ok(accuracy)
}

fn name(adapter: &str) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&EDITION.to_le_bytes());
    hasher.update(env!("CARGO_PKG_VERSION").as_bytes());
    for function in Accuracy::functions() {
        hasher.update(function.as_bytes());
    }
    hasher.update(adapter.as_bytes());
    hasher.finalize().to_hex().to_string()
}

fn read(file: &FilePath) -> Option<Accuracy> {
    let bytes = std::fs::read(file).ok()?;
    let whole = bytes.len() % 4 == 0;
    Accuracy::from_words(&whole.then(|| bytemuck::pod_collect_to_vec(&bytes))?)
}

fn measure(executor: &dyn Executor) -> Result<Accuracy, ProbeError> {
    let functions: Vec<&str> = Accuracy::functions().collect();
    let text: String = (0..)
        .zip(&functions)
        .map(|(index, function): (usize, _)| {
            let two = function.ends_with(", b)");
            let parameters = if two { "a: f32, b: f32" } else { "a: f32" };
            format!("fn f{index}({parameters}) -> f32 {{ return {function}; }}\n")
        })
        .collect();
    let package = Package::from_source("accuracy", text.as_str());
    let fixtures = Vec::new();
    let mut accuracy = Accuracy::new();
    for (index, function) in functions.into_iter().enumerate() {
        let probed = Probed::new(&package, &format!("f{index}"))?;
        let width = probed.function().parameters.len();
        let rows: Vec<u32> = Accuracy::arguments(function).into_iter().map(f32::to_bits).collect();
        let cases = rows.len() / width;
        let caller = Caller::new(executor, Cow::Owned(probed), &fixtures, cases)?;
        let results = caller.results(&rows, cases)?;
        let results: Vec<f32> = results.into_iter().map(f32::from_bits).collect();
        accuracy.take(function, &results);
    }
    Ok(accuracy)
}
