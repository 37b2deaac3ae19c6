//! Goldens of values: results of functions for fixed arguments, and buffers after passes.

use std::fmt::Write;

use super::content::PENDING_TABLE;
use super::pending::processor;
use super::table::{Table, TableError};
use super::{Goldens, Pending, Provenance, is_name};
use crate::diagnostic::{FileRead, shown};
use crate::image::{ImageError, Precision, write_whole};
use crate::package::LinkedModule;
use crate::path::Adapter;

pub(crate) struct Made<'a> {
    pub(crate) table: Table,
    pub(crate) adapter: &'a Adapter,
    pub(crate) shader: String,
    pub(crate) modules: Vec<LinkedModule>,
    pub(crate) tolerance: String,
}

/// The reason why values fail, or why Karat can't compare them.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ValuesError {
    /// The name is empty, has two `/` in a row, begins or ends with `/`, or has a character that isn't allowed.
    #[error("`{0}` can't name a golden: use letters, digits, `-`, `_` and `/`")]
    Name(String),
    /// There is no golden yet.
    #[error(
        "the values `{case}` have no golden; look at `{pending}` and accept it with \
         `karat accept {case}{arguments} --because \"...\"`"
    )]
    Missing {
        /// The golden's name.
        case: String,
        /// The file of the new values.
        pending: String,
        /// Options that the `karat accept` command in the message needs, such as `--any-adapter`.
        arguments: String,
    },
    /// The golden can't be used. Karat doesn't overwrite it.
    #[error("the golden of the values `{case}` can't be used: {cause}{}",
        if matches!(cause, TableError::File(_)) { "" } else { "; restore the file from version control, or delete it, run its test and accept the new values" })]
    Unreadable {
        /// The golden's name.
        case: String,
        /// The reason.
        cause: TableError,
    },
    /// The values differ from the golden.
    #[error("the values `{case}` differ from their golden `{golden}`: {difference}\n  {advice}")]
    Differs {
        /// The golden's name.
        case: String,
        /// The golden's file.
        golden: String,
        /// The difference.
        difference: String,
        /// Advice on the next step.
        advice: String,
    },
    /// A value is NaN or infinite, so the values can't become a golden.
    #[error(
        "the values `{case}` can't be compared: {column} is {value} in row {row}, and a \
         golden can't have this value; {advice}"
    )]
    NonFinite {
        /// The golden's name.
        case: String,
        /// The column.
        column: String,
        /// The value: NaN or infinity.
        value: f64,
        /// The row's number, from 1.
        row: usize,
        /// Advice on the next step.
        advice: &'static str,
    },
    /// Karat can't write the pending file.
    #[error(
        "the values `{case}` fail ({failure}), and Karat can't write them into a pending file: {cause}"
    )]
    Pending {
        /// The golden's name.
        case: String,
        /// The reason why the values fail.
        failure: String,
        /// The reason.
        cause: ImageError,
    },
}

impl ValuesError {
    /// Checks if the error means that the values are wrong. Returns `false` if Karat can't tell, for example without a
    /// golden.
    pub(crate) fn is_failure(&self) -> bool {
        matches!(self, Self::Differs { .. } | Self::NonFinite { .. })
    }
}

impl Goldens {
    /// The golden's file, which all paths share. If a path computes other values, you give that path its own tolerance
    /// in the test.
    pub(super) fn values(&self, case: &str) -> std::path::PathBuf {
        self.folder().join(format!("{case}.csv"))
    }

    pub(crate) fn values_read(&self, case: &str) -> Option<FileRead> {
        is_name(case).then(|| FileRead::now(&self.values(case)))
    }

    /// The golden's values. Returns `None` if there is no golden yet.
    pub(crate) fn table(&self, case: &str) -> Result<Option<Table>, ValuesError> {
        if !is_name(case) {
            return Err(ValuesError::Name(case.to_owned()));
        }
        match Table::read(&self.values(case)) {
            Ok((table, _)) => Ok(Some(table)),
            Err(TableError::File(ImageError::Missing { .. })) => Ok(None),
            Err(cause) => Err(ValuesError::Unreadable { case: case.to_owned(), cause }),
        }
    }

    /// Writes values that have no golden into a pending file.
    pub(crate) fn without_golden(&self, case: &str, made: &Made<'_>) -> ValuesError {
        match self.leave(case, made, None) {
            Ok(pending) => ValuesError::Missing {
                case: case.to_owned(),
                pending: shown(&pending.path),
                arguments: pending.accept_arguments() + &self.arguments(),
            },
            Err(error) => error,
        }
    }

    /// Writes values that differ from their golden into a pending file. `difference` is the text of the
    /// difference.
    pub(crate) fn unlike_golden(
        &self,
        case: &str,
        made: &Made<'_>,
        golden: &Table,
        difference: &str,
    ) -> ValuesError {
        match self.leave(case, made, Some((golden, difference))) {
            Ok(pending) => {
                let (arguments, place) = (pending.accept_arguments(), self.arguments());
                ValuesError::Differs {
                    case: case.to_owned(),
                    golden: shown(&self.values(case)),
                    difference: difference.to_owned(),
                    advice: format!(
                        "look at `{}`, then `karat accept {case}{arguments}{place} --because \
                         \"...\"` or `karat reject {case}{place}`",
                        shown(&pending.path)
                    ),
                }
            }
            Err(error) => error,
        }
    }

    /// Removes the pending file of values that now agree with their golden, if there is such a file.
    pub(crate) fn values_agree(&self, case: &str) {
        drop(std::fs::remove_file(self.pending_values(case)));
    }

    fn pending_values(&self, case: &str) -> std::path::PathBuf {
        self.pending_folder().join(format!("{case}{PENDING_TABLE}"))
    }

    fn leave(
        &self,
        case: &str,
        made: &Made<'_>,
        against: Option<(&Table, &str)>,
    ) -> Result<Pending, ValuesError> {
        let Made { table, adapter, shader, modules, tolerance } = made;
        if let Some((row, at, value)) = table.non_finite() {
            let advice = match at < table.arguments {
                true => "restrict the domain",
                false => "fix the shader, or restrict the domain of an argument",
            };
            return Err(ValuesError::NonFinite {
                case: case.to_owned(),
                column: format!("`{}`", table.columns[at].name),
                value,
                row: row + 1,
                advice,
            });
        }
        let count = |number: usize| u32::try_from(number).unwrap_or(u32::MAX);
        let provenance = Provenance {
            schema: Provenance::SCHEMA,
            case: case.to_owned(),
            shader: shader.clone(),
            modules: self.module_hashes(modules),
            pixels: table.hash(),
            width: count(table.columns.len()),
            height: count(table.len()),
            color_space: String::new(),
            precision: Precision::Float,
            tolerance: tolerance.clone(),
            adapter: (*adapter).clone(),
            processor: processor(),
            facts: std::collections::BTreeMap::new(),
            folder: self.key(),
            cargo_package: self.cargo_package(),
            compared_with: against.map_or_else(String::new, |(golden, _)| golden.hash()),
            compared_profile: String::new(),
            finding: against.map(|(_, difference)| super::FrameFinding {
                verdict: difference.to_owned(),
                margins: Vec::new(),
                base_passes: false,
            }),
            exposures: None,
            table: Some(table.facts()),
            accepted_by: String::new(),
            accepted_at: String::new(),
            because: String::new(),
        };
        let path = self.pending_values(case);
        match write_whole(&path, table.text(&provenance).as_bytes()) {
            Ok(()) => Ok(Pending { case: case.to_owned(), path, provenance }),
            Err(cause) => Err(ValuesError::Pending {
                case: case.to_owned(),
                failure: against.map_or("they have no golden", |(_, how)| how).to_owned(),
                cause: ImageError::Write { path: shown(&path), cause },
            }),
        }
    }
}

/// Compares the columns of new values with the golden's columns, and describes both if they differ. Returns `None` if
/// the columns are equal.
pub(crate) fn other_columns(golden: &Table, made: &Table) -> Option<String> {
    if golden.columns == made.columns && golden.arguments == made.arguments {
        return None;
    }
    let shown = |table: &Table| {
        let mut text = String::new();
        for (at, column) in table.columns.iter().enumerate() {
            let between = match at {
                0 => "",
                _ if at == table.arguments => " -> ",
                _ => ", ",
            };
            let _ = write!(text, "{between}{}: {}", column.name, column.scalar.wgsl());
        }
        text
    };
    Some(format!(
        "its columns are {}, but the result has the columns {}",
        shown(golden),
        shown(made)
    ))
}
