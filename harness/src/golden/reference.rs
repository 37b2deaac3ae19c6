//! The golden of a comparison: its pixels and its provenance.

use std::path::Path;

use super::compare::{FrameDifference, FrameMargin, Terms, compare};
use super::{FrameTolerance, Profile, Provenance, ProvenanceError, Rendered, parts};
use crate::image::{Image, ImageError, Precision};
use crate::metric::DEFAULT_RELATIVE;

pub(super) struct Reference {
    image: Image,
    /// `None` if another tool made the file.
    provenance: Option<Provenance>,
    /// The golden's variance. Karat reads the variance only for noisy frames.
    variance: Option<Image>,
}

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

    /// Checks if the file has 32-bit floats. If another tool wrote the file, Karat assumes 32-bit floats, because their
    /// comparison is stricter.
    fn is_in_floats(&self) -> bool {
        self.provenance.as_ref().is_none_or(|known| known.precision == Precision::Float)
    }

    pub(super) fn hash(&self) -> String {
        self.image.hash()
    }

    pub(super) fn tolerance(&self, frame: &Rendered<'_>) -> FrameTolerance {
        if let Some(declared) = frame.tolerance {
            return declared.clone();
        }
        if frame.variance.is_some() {
            // FLIP would measure the noise, and miss smaller differences.
            return FrameTolerance::gate(DEFAULT_RELATIVE);
        }
        // If the golden's origin is unknown, the stricter bounds of the golden's own profile apply.
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
        // The golden's file has half floats, so the frame is rounded to half floats, too.
        match compare(&self.image, &frame.image.rounded_to(Precision::Half), &terms) {
            // The frame may have finite values that are too large for half floats.
            Err(FrameDifference::NonFinite(_)) => compare(&self.image, frame.image, &terms),
            compared => compared,
        }
    }
}
