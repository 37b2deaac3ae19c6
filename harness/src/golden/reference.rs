//! What a frame is compared with: a golden's pixels, and what is known of them.

use std::path::Path;

use super::compare::{FrameDifference, FrameMargin, Terms, compare};
use super::{FrameTolerance, Profile, Provenance, ProvenanceError, Rendered, parts};
use crate::image::{Image, ImageError, Precision};
use crate::metric::DEFAULT_RELATIVE;

/// A golden that was read.
pub(super) struct Reference {
    image: Image,
    /// `None`: it was made by another tool.
    provenance: Option<Provenance>,
    /// Its variance, if it has one and somebody asked.
    variance: Option<Image>,
}

/// Why a golden can't be compared with.
pub(super) enum ReferenceError {
    Image(ImageError),
    Provenance(ProvenanceError),
}

impl From<ImageError> for ReferenceError {
    fn from(source: ImageError) -> Self {
        Self::Image(source)
    }
}

impl Reference {
    pub(super) fn read(file: &Path, noisy: bool) -> Result<Self, ReferenceError> {
        parts::check_file(file)?;
        let (image, metadata) = Image::read_exr(file)?;
        let provenance = metadata.as_deref().map(Provenance::parse).transpose();
        let provenance = provenance.map_err(ReferenceError::Provenance)?;
        let variance = if noisy { parts::read(file, parts::VARIANCE)? } else { None };
        Ok(Self { image, provenance, variance })
    }

    /// Another tool's is taken to be, to be on the safe side.
    fn is_in_floats(&self) -> bool {
        self.provenance.as_ref().is_none_or(|known| known.precision == Precision::Float)
    }

    pub(super) fn hash(&self) -> String {
        self.image.hash()
    }

    /// What a frame may differ by from this golden.
    pub(super) fn tolerance(&self, frame: &Rendered<'_>) -> FrameTolerance {
        if let Some(declared) = frame.tolerance {
            return declared.clone();
        }
        if frame.variance.is_some() {
            // FLIP would see the noise, and let pass what is fainter.
            return FrameTolerance::gate(DEFAULT_RELATIVE);
        }
        // Of an unknown origin it is held to the bounds of its own profile.
        let made_on = self.provenance.as_ref().map(|known| Profile::of(&known.adapter));
        FrameTolerance::standard(made_on.is_some_and(|made| made != Profile::of(frame.adapter)))
    }

    pub(super) fn compare(&self, frame: &Rendered<'_>) -> Result<FrameMargin, FrameDifference> {
        let terms = Terms {
            tolerance: &self.tolerance(frame),
            mask: frame.mask,
            exposures: self.provenance.as_ref().and_then(|known| known.exposures),
            noise: frame.variance.map(|actual| (self.variance.as_ref(), actual)),
        };
        if self.is_in_floats() || frame.asks_for_floats() {
            return compare(&self.image, frame.image, &terms);
        }
        // A frame as this golden's file would hold it.
        match compare(&self.image, &frame.image.rounded_to(Precision::Half), &terms) {
            // What half floats can't hold may be finite all the same.
            Err(FrameDifference::NonFinite(_)) => compare(&self.image, frame.image, &terms),
            compared => compared,
        }
    }
}
