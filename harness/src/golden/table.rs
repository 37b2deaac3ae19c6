//! Tables of values as text: arguments and results of a function, or elements of a buffer.
//!
//! ```text
//! # schema = 1
//! # case = "ggx"
//! n_dot_h,alpha,result
//! 0.5,0.25,0.0796
//! ```
//!
//! The lines with `#` contain the provenance of the values, as TOML. The other lines are CSV. The cells are numbers,
//! `true` or `false`, so they need no quotes.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{Provenance, ProvenanceError, parts};
use crate::diagnostic::shown;
use crate::image::ImageError;
use crate::output::counted;
use crate::value::{Scalar, format_lane};

/// A column of a [`Table`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// The column's name: `n_dot_h`, `result.x`, or a component of a buffer such as `sums.x`.
    pub name: String,
    /// The type of the column's cells.
    pub scalar: Scalar,
}

/// Rows of numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    /// The columns: first the arguments, then the results.
    pub columns: Vec<Column>,
    /// The number of columns that are arguments.
    pub arguments: usize,
    /// The values of all rows as `u32` words, row by row.
    pub(crate) words: Vec<u32>,
}

/// The facts about a table's columns.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableFacts {
    /// The number of columns that are arguments.
    pub arguments: usize,
    /// The type of each column's cells: `f32`, `f16`, `i32`, `u32` or `bool`.
    pub types: Vec<String>,
}

/// The reason why Karat can't use a file as a table.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// The file can't be read.
    #[error(transparent)]
    File(#[from] ImageError),
    /// The provenance in the file's comments can't be used.
    #[error("`{path}` can't be used: {cause}")]
    Provenance {
        /// The file.
        path: String,
        /// The reason.
        cause: ProvenanceError,
    },
    /// A line isn't valid.
    #[error("`{path}`:{line} {reason}")]
    Line {
        /// The file.
        path: String,
        /// The line's number, from 1.
        line: usize,
        /// The defect of the line.
        reason: String,
    },
}

impl Table {
    /// The `u32` words of each row.
    pub fn rows(&self) -> impl Iterator<Item = &[u32]> {
        self.words.chunks_exact(self.columns.len().max(1))
    }

    /// The arguments and the results of each row, as `u32` words.
    pub fn split_rows(&self) -> impl Iterator<Item = (&[u32], &[u32])> {
        self.rows().map(|row| row.split_at(self.arguments.min(row.len())))
    }

    /// The number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.words.len() / self.columns.len().max(1)
    }

    /// Checks if the table has no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The first cell that is NaN or infinite: its row, its column, and its value.
    pub(super) fn non_finite(&self) -> Option<(usize, usize, f64)> {
        self.rows().enumerate().find_map(|(at, row)| {
            let cells = self.columns.iter().zip(row).enumerate();
            let mut values =
                cells.map(|(index, (column, word))| (index, column.scalar.decode(*word)));
            values.find(|(_, value)| !value.is_finite()).map(|(index, value)| (at, index, value))
        })
    }

    pub(super) fn facts(&self) -> TableFacts {
        let types = self.columns.iter().map(|column| column.scalar.wgsl().to_owned()).collect();
        TableFacts { arguments: self.arguments, types }
    }

    pub(super) fn hash(&self) -> String {
        blake3::hash(self.cells().as_bytes()).to_hex().to_string()
    }

    pub(super) fn text(&self, provenance: &Provenance) -> String {
        let facts = toml::to_string(provenance).expect("provenance is plain data");
        let facts = facts.lines().map(|line| match line {
            "" => "#\n".to_owned(),
            line => format!("# {line}\n"),
        });
        facts.collect::<String>() + &self.cells()
    }

    fn cells(&self) -> String {
        let names = self.columns.iter().map(|column| column.name.clone());
        let mut text = names.collect::<Vec<_>>().join(",") + "\n";
        for row in self.rows() {
            let cells = self.columns.iter().zip(row);
            let cells = cells.map(|(column, word)| format_lane(column.scalar, *word));
            text += &cells.collect::<Vec<_>>().join(",");
            text.push('\n');
        }
        text
    }

    /// Reads a table and its provenance.
    ///
    /// # Errors
    /// Returns an error if the file can't be read, or a line isn't valid.
    pub fn read(file: &Path) -> Result<(Self, Provenance), TableError> {
        parts::check_file(file)?;
        let path = || shown(file);
        let text = std::fs::read_to_string(file).map_err(|cause| match cause.kind() {
            std::io::ErrorKind::NotFound => ImageError::Missing { path: path() },
            _ => ImageError::Read { path: path(), cause },
        })?;
        if text.starts_with("version https://git-lfs.github.com/spec/") {
            return Err(ImageError::LfsPointer { path: path() }.into());
        }
        let facts: String = text
            .lines()
            .take_while(|line| line.starts_with('#'))
            .map(|line| line[1..].trim_start().to_owned() + "\n")
            .collect();
        let damaged = |cause| TableError::Provenance { path: path(), cause };
        let provenance = Provenance::parse_toml(&facts).map_err(damaged)?;
        let Some(facts) = &provenance.table else {
            let reason = "it doesn't describe a table".to_owned();
            return Err(damaged(ProvenanceError::Damaged(reason)));
        };
        let line_is = |line: usize, reason: String| TableError::Line { path: path(), line, reason };
        let mut lines = text.lines().enumerate().skip_while(|(_, line)| line.starts_with('#'));
        let head = lines.next().map(|(at, line)| (at + 1, line));
        let (at, head) = head.ok_or_else(|| line_is(1, "has no header line".to_owned()))?;
        let names: Vec<&str> = head.split(',').collect();
        let scalars: Option<Vec<Scalar>> =
            facts.types.iter().map(|name| Scalar::named(name)).collect();
        let scalars = scalars
            .filter(|scalars| scalars.len() == names.len() && facts.arguments < scalars.len());
        let Some(scalars) = scalars else {
            let reason = format!(
                "has {}, but the metadata describes other columns",
                counted(names.len(), "column")
            );
            return Err(line_is(at, reason));
        };
        let columns = names.iter().zip(scalars);
        let columns: Vec<Column> =
            columns.map(|(name, scalar)| Column { name: (*name).to_owned(), scalar }).collect();
        let mut words = Vec::new();
        for (at, line) in lines {
            let cells: Vec<&str> = line.split(',').collect();
            if cells.len() != columns.len() {
                let reason = format!(
                    "has {} in {}",
                    counted(cells.len(), "cell"),
                    counted(columns.len(), "column")
                );
                return Err(line_is(at + 1, reason));
            }
            for (column, cell) in columns.iter().zip(cells) {
                words.push(column.scalar.parse(cell).ok_or_else(|| {
                    let Column { name, scalar } = column;
                    let what = scalar.wgsl();
                    line_is(at + 1, format!("column `{name}`: `{cell}` isn't a finite {what}"))
                })?);
            }
        }
        if words.is_empty() {
            return Err(line_is(at, "is the header, but no rows follow".to_owned()));
        }
        let table = Self { columns, arguments: facts.arguments, words };
        Ok((table, provenance))
    }
}
