//! Reading cases from files.

use super::maps::maps;
use super::{Case, Cause, MOST_ROWS, Part, Rows};
use karat::golden::{COLOR, TableError};
use karat::image::ImageError;
use karat::metric::Mask;
use karat::unstable::golden::{AcceptError, ChangedRow, Pending, Provenance, Table};
use karat::unstable::image::ExrFile;
use karat::unstable::metric::MASK;
use karat::unstable::metric::Pair;
use karat::{Goldens, Image};

impl Case {
    /// Returns the mask of the comparison, or `None` if the test declared no mask.
    #[must_use]
    pub fn mask(&self) -> Option<Mask> {
        let part = self.parts.iter().skip(1).find(|part| part.name == MASK)?;
        part.actual.clone().map(Mask::image)
    }

    /// Reads a pending frame and its golden. If the golden is unreadable, the verdict says so, and you can replace the
    /// golden by accepting the frame.
    ///
    /// # Errors
    /// Returns an error if the pending frame can't be read.
    pub fn load(goldens: &Goldens, pending: &Pending) -> Result<Self, AcceptError> {
        if pending.is_table() {
            return Self::load_table(goldens, pending);
        }
        let actual = ExrFile::read(&pending.path)?;
        let (golden, unreadable) = match ExrFile::read(&goldens.compared(pending)) {
            Ok(golden) => (Some(golden), None),
            Err(ImageError::Missing { .. }) => (None, None),
            Err(error) => (None, Some(error)),
        };
        let metadata = golden.as_ref().and_then(|golden| golden.metadata.as_deref());
        let golden_provenance = metadata.and_then(|metadata| Provenance::parse(metadata).ok());
        let actual_provenance = pending.provenance.clone();
        let cause = Cause::of(
            golden.is_some() || unreadable.is_some(),
            golden_provenance.as_ref(),
            &actual_provenance,
        );
        let golden_image = golden.as_ref().map(|golden| &golden.parts[0].image);
        let (verdict, margins) = match (&unreadable, &actual_provenance.finding) {
            (Some(error), _) => (format!("the golden can't be used: {error}"), Vec::new()),
            _ if golden_image.map_or_else(String::new, Image::hash)
                != actual_provenance.compared_with =>
            {
                let changed =
                    "the golden changed since this frame was rendered: run the frame's test again";
                (changed.to_owned(), Vec::new())
            }
            (None, Some(finding)) => (finding.verdict.clone(), finding.margins.clone()),
            (None, None) if golden.is_none() => ("there is no golden yet".to_owned(), Vec::new()),
            (None, None) => (
                "the pending file doesn't describe the difference: run the frame's test again"
                    .to_owned(),
                Vec::new(),
            ),
        };
        let maps = golden_image.map_or_else(Vec::new, |golden_image| {
            let exposures = golden_provenance.as_ref().and_then(|known| known.exposures);
            let (image, mask) = (&actual.parts[0].image, actual.mask());
            let pair = match &mask {
                Some(mask) => Pair::masked(golden_image, image, mask),
                // The golden's exposures were computed from all pixels, so they apply only without a mask.
                None => Pair::new(golden_image, image)
                    .map(|pair| exposures.into_iter().fold(pair, Pair::with_exposures)),
            };
            pair.map_or_else(|_| Vec::new(), |pair| maps(&pair))
        });
        Ok(Self {
            name: pending.case.clone(),
            parts: parts(golden, actual),
            maps,
            margins,
            verdict,
            golden_provenance,
            actual_provenance,
            cause,
            table: None,
        })
    }

    fn load_table(goldens: &Goldens, pending: &Pending) -> Result<Self, AcceptError> {
        let (actual, actual_provenance) = Table::read(&pending.path)?;
        let file = goldens.compared(pending);
        let (golden_provenance, unreadable) = match Table::read(&file) {
            Ok((_, provenance)) => (Some(provenance), None),
            Err(TableError::File(ImageError::Missing { .. })) => (None, None),
            Err(error) => (None, Some(error)),
        };
        let there = golden_provenance.is_some() || unreadable.is_some();
        let cause = Cause::of(there, golden_provenance.as_ref(), &actual_provenance);
        let known = golden_provenance.as_ref().map_or("", |known| known.pixels.as_str());
        let verdict = match (&unreadable, &actual_provenance.finding) {
            (Some(error), _) => format!("the golden can't be used: {error}"),
            _ if known != actual_provenance.compared_with => {
                "the golden changed since these values were computed: run their test again"
                    .to_owned()
            }
            (None, Some(finding)) => finding.verdict.clone(),
            (None, None) => "there is no golden yet".to_owned(),
        };
        let rows = if unreadable.is_some() { Vec::new() } else { pending.changed_rows(goldens)? };
        let table = Some(Rows::of(&actual, rows));
        Ok(Self {
            name: pending.case.clone(),
            parts: Vec::new(),
            maps: Vec::new(),
            margins: Vec::new(),
            verdict,
            golden_provenance,
            actual_provenance,
            cause,
            table,
        })
    }
}

impl Rows {
    /// Makes the data for the page from the changed `rows` of a table, and keeps at most `MOST_ROWS` rows.
    pub(super) fn of(table: &Table, mut rows: Vec<ChangedRow>) -> Self {
        let changed = rows.len();
        rows.truncate(MOST_ROWS);
        let columns = table.columns.iter().map(|column| column.name.clone()).collect();
        Self { columns, arguments: table.arguments, rows, changed }
    }
}

/// Returns the parts of golden and frame, matched by name. The frame's parts come first, then the parts that only the
/// golden has.
fn parts(golden: Option<ExrFile>, actual: ExrFile) -> Vec<Part> {
    // In another tool's golden, the first part has another name, or no name.
    let named = |(index, part): (usize, karat::unstable::image::Part)| {
        (if index == 0 { COLOR.to_owned() } else { part.name }, part.image)
    };
    let mut golden: Vec<_> =
        golden.into_iter().flat_map(|file| file.parts).enumerate().map(named).collect();
    let mut all = Vec::new();
    for (name, image) in actual.parts.into_iter().enumerate().map(named) {
        let same = golden.iter().position(|(other, _)| *other == name);
        let golden = same.map(|index| golden.swap_remove(index).1);
        all.push(Part { name, golden, actual: Some(image) });
    }
    all.extend(golden.into_iter().map(|(name, image)| Part {
        name,
        golden: Some(image),
        actual: None,
    }));
    all
}
