//! From files to cases.

use super::gates::Judged;
use super::{Case, Cause, Part, ReviewError};
use crate::diagnostic::shown;
use crate::golden::{AcceptError, Goldens, Pending, Provenance};
use crate::image::{Image, ImageError};

/// The pending frames, each of which is where its name says: names are printed in commands and
/// become the paths of goldens, and a file may come from somebody else's machine.
pub(super) fn pending(goldens: &Goldens) -> Result<Vec<Pending>, ReviewError> {
    let pending = goldens.pending()?;
    for Pending { case, path, .. } in &pending {
        if *path != goldens.folder().join(format!("{case}.new.exr")) {
            let (path, case) = (shown(path), case.clone());
            return Err(AcceptError::Misplaced { path, case }.into());
        }
    }
    Ok(pending)
}

/// The golden that a frame was compared with: that of a profile if it says so.
fn golden_file(pending: &Pending) -> String {
    let Pending { case, provenance, .. } = pending;
    let profile = &provenance.compared_profile;
    let sound = profile.chars().all(|c| c.is_ascii_alphanumeric() || c == '-');
    if profile.is_empty() || !sound {
        format!("{case}.exr")
    } else {
        format!("@{profile}/{case}.exr")
    }
}

impl Case {
    /// Reads a pending frame and its golden, and compares them. A golden that can't be read is
    /// reported in the verdict, since accepting replaces it.
    ///
    /// # Errors
    /// If the pending frame can't be read.
    pub fn load(goldens: &Goldens, pending: &Pending) -> Result<Self, AcceptError> {
        let (actual, _) = Image::read_exr(&pending.path)?;
        let path = goldens.folder().join(golden_file(pending));
        let (golden, metadata, unreadable) = match Image::read_exr(&path) {
            Ok((golden, metadata)) => (Some(golden), metadata, None),
            Err(ImageError::Missing { .. }) => (None, None, None),
            Err(error) => (None, None, Some(error)),
        };
        let golden_provenance: Option<Provenance> =
            metadata.and_then(|metadata| serde_json::from_str(&metadata).ok());
        let actual_provenance = pending.provenance.clone();
        let cause = Cause::of(
            golden.is_some() || unreadable.is_some(),
            golden_provenance.as_ref(),
            &actual_provenance,
        );
        let known = golden.as_ref().map(|golden| (golden, golden_provenance.as_ref()));
        let Judged { mut verdict, gates, maps } = Judged::of(known, &actual, &actual_provenance);
        if let Some(error) = unreadable {
            verdict = format!("the golden can't be used: {error}");
        }
        Ok(Self {
            name: pending.case.clone(),
            parts: vec![Part { name: "color".to_owned(), golden, actual: Some(actual) }],
            maps,
            gates,
            verdict,
            golden_provenance,
            actual_provenance,
            cause,
        })
    }
}
