//! The content of a pending file or a golden: the parts of a frame, or a table.

use std::path::Path;

use super::table::{Table, TableError};
use super::{AcceptError, Provenance, parts};
use crate::image::{ExrFile, ImageError, Part};
use crate::metric::ExposureRange;

pub(super) const PENDING_TABLE: &str = ".new.csv";
pub(super) const PENDING_FRAME: &str = ".new.exr";

pub(super) fn is_table(file: &Path) -> bool {
    file.extension().is_some_and(|ending| ending == "csv")
}

#[derive(Debug)]
pub(super) enum Content {
    Frame(Vec<Part>),
    Table(Table),
}

impl Content {
    /// Reads a file's content, and its provenance if the file has one.
    pub(super) fn read(file: &Path) -> Result<(Self, Option<Provenance>), AcceptError> {
        let path = || crate::diagnostic::shown(file);
        if is_table(file) {
            return match Table::read(file) {
                Ok((table, provenance)) => Ok((Self::Table(table), Some(provenance))),
                Err(TableError::File(error)) => Err(error.into()),
                Err(error) => Err(error.into()),
            };
        }
        parts::check_file(file)?;
        let ExrFile { parts, metadata } = ExrFile::read(file)?;
        let provenance = metadata.as_deref().map(Provenance::parse).transpose();
        let provenance =
            provenance.map_err(|cause| AcceptError::Provenance { path: path(), cause })?;
        Ok((Self::Frame(parts), provenance))
    }

    pub(super) fn hash(&self) -> String {
        match self {
            Self::Frame(parts) => parts.first().map_or_else(String::new, |part| part.image.hash()),
            Self::Table(table) => table.hash(),
        }
    }

    /// Checks if any value of the content is NaN or infinite. Pixels outside of the mask don't count.
    pub(super) fn non_finite(&self) -> bool {
        match self {
            Self::Frame(parts) => parts::non_finite(parts),
            Self::Table(table) => table.non_finite().is_some(),
        }
    }

    pub(super) fn exposures(&self) -> Option<ExposureRange> {
        match self {
            Self::Frame(parts) => Some(ExposureRange::of(&parts.first()?.image)),
            Self::Table(_) => None,
        }
    }

    /// Checks if both contents have the same bits. The function compares hashes, because a NaN isn't equal to
    /// itself. Pixels that the mask leaves out may be NaN.
    pub(super) fn is(&self, other: &Self) -> bool {
        let same = |(a, b): (&Part, &Part)| {
            a.name == b.name && a.precision == b.precision && a.image.hash() == b.image.hash()
        };
        match (self, other) {
            (Self::Frame(a), Self::Frame(b)) => a.len() == b.len() && a.iter().zip(b).all(same),
            (Self::Table(a), Self::Table(b)) => a == b,
            _ => false,
        }
    }

    pub(super) fn bytes(self, file: &Path, provenance: &Provenance) -> Result<Vec<u8>, ImageError> {
        match self {
            Self::Frame(parts) => {
                ExrFile { parts, metadata: Some(provenance.metadata()) }.bytes(file)
            }
            Self::Table(table) => Ok(table.text(provenance).into_bytes()),
        }
    }
}
