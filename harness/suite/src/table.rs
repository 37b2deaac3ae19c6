//! Tables of expected values: CSV files with a column for each component of the arguments and of the result.

use std::collections::HashMap;
use std::path::Path;

use karat::unstable::diagnostic::{read_file, shown};
use karat::unstable::domain::Part;
use karat::unstable::value::{Scalar, Shape};

use crate::numbers::{self, Wanted};
use crate::rows::{MARKED, Places, begins_with_mark, head_of, line_of};
use crate::wrong::Misdeclared;

#[derive(Debug)]
pub(crate) struct Table {
    /// The scalars of each row's arguments, as 32-bit words.
    pub(crate) rows: Vec<Vec<u32>>,
    /// The expected scalars of the result, by the row's arguments.
    pub(crate) expected: HashMap<Vec<u32>, Vec<f64>>,
}

const RESULT: &str = "result";

pub(crate) fn read(
    file: &Path,
    parameters: &[(String, Shape)],
    result: &Shape,
    compared: Wanted,
) -> Result<Table, Misdeclared> {
    let name = file.display();
    let text = read_file(file).map_err(|error| format!("can't read `{name}`: {error}"))?;
    let mut reader = reader(&text);
    let head = reader.headers().map_err(|error| format!("`{name}`: {error}"))?.clone();
    let argument = |(name, shape): &(String, Shape)| columns(name, shape);
    let arguments: Vec<(String, Scalar)> = parameters.iter().flat_map(argument).collect();
    let results = columns(RESULT, result);
    fn names(columns: &[(String, Scalar)]) -> Vec<&str> {
        columns.iter().map(|(name, _)| &**name).collect()
    }
    let own: Vec<&str> = head.iter().collect();
    let places = Places::of_head(&own, &names(&arguments), &names(&results))
        .map_err(|why| format!("`{name}` {why}"))?;
    let placed = |places: Vec<usize>, columns: Vec<(String, Scalar)>| {
        places.into_iter().zip(columns.into_iter().map(|(_, scalar)| scalar)).collect::<Vec<_>>()
    };
    let (arguments, results) =
        (placed(places.arguments, arguments), placed(places.expected, results));
    let (mut rows, mut expected) = (Vec::new(), HashMap::new());
    for (begins, record) in placed_rows(&mut reader, &text) {
        let line = line_of(&text, begins);
        let at = |message: String| Misdeclared::at_line(file, line, message);
        if begins_with_mark(&text, begins) {
            return Err(at(format!("`{name}`: {MARKED}")));
        }
        let record = record.map_err(|error| at(format!("`{name}`: {error}")))?;
        let wrong = |column: usize, what: &str| {
            let (cell, column) = (&record[column], &head[column]);
            at(format!("column `{column}`: `{cell}` {what}"))
        };
        let mut words = Vec::with_capacity(arguments.len());
        for (column, scalar) in &arguments {
            let cell = &record[*column];
            let word = numbers::argument(*scalar, cell);
            words.push(
                word.ok_or_else(|| {
                    wrong(*column, &format!("isn't of type {}", type_name(*scalar)))
                })?,
            );
        }
        let mut lanes = Vec::with_capacity(results.len());
        for (column, scalar) in &results {
            let cell = &record[*column];
            let value = numbers::expected(*scalar, cell, compared);
            let column = &head[*column];
            lanes.push(value.map_err(|why| at(format!("column `{column}`: {why}")))?);
        }
        if let Some(other) = expected.insert(words.clone(), lanes.clone())
            && other != lanes
        {
            return Err(
                at("a row above has the same arguments, but a different result".to_owned()),
            );
        }
        rows.push(words);
    }
    if rows.is_empty() {
        return Err(format!("the table `{name}` has no rows: add a row").into());
    }
    Ok(Table { rows, expected })
}

/// Reads a table of a resource's expected elements. Each row is an element. The columns are `x,y,z` or `value`.
pub(crate) fn elements(
    file: &Path,
    element: &Shape,
    compared: Wanted,
) -> Result<Vec<f64>, Misdeclared> {
    let name = shown(file);
    let text = read_file(file).map_err(|error| format!("can't read `{name}`: {error}"))?;
    let own = |name: String| match &*name {
        "" => "value".to_owned(),
        lane => lane.trim_start_matches('.').to_owned(),
    };
    let wanted: Vec<String> = element.lane_names().into_iter().map(own).collect();
    let mut reader = reader(&text);
    let head = reader.headers().map_err(|error| format!("`{name}`: {error}"))?;
    if head.iter().ne(wanted.iter().map(String::as_str)) {
        let (wanted, there) = (wanted.join(","), head.iter().collect::<Vec<_>>().join(","));
        let message = format!("the first line of `{name}` must be `{wanted}`, but is `{there}`");
        return Err(Misdeclared::at_line(file, 1, message));
    }
    let (scalars, mut all) = (element.lanes(), Vec::new());
    for (begins, record) in placed_rows(&mut reader, &text) {
        let line = line_of(&text, begins);
        let at = |message: String| Misdeclared::at_line(file, line, message);
        let record = record.map_err(|error| at(error.to_string()))?;
        for (scalar, cell) in scalars.iter().zip(&record) {
            all.push(numbers::expected(*scalar, cell, compared).map_err(at)?);
        }
    }
    Ok(all)
}

impl Table {
    /// The domain of the arguments: each row is one case.
    pub(crate) fn part(&self, shapes: &[Shape]) -> Part {
        let scalars = shapes.iter().flat_map(Shape::lanes).collect();
        Part::listed(scalars, self.rows.clone())
    }
}

/// The columns of a value: `v.x`, `v.y` for a vector, and only the name for a number.
fn columns(name: &str, shape: &Shape) -> Vec<(String, Scalar)> {
    let lanes = shape.lane_names().into_iter().zip(shape.lanes());
    lanes.map(|(lane, scalar)| (format!("{name}{lane}"), scalar)).collect()
}

/// The last line of an error message: the position of a row in a table's file. The first `row` is 0. `None` if the file
/// has no such row.
pub(crate) fn told(what: &str, file: &Path, row: u64) -> Option<String> {
    let text = read_file(file).ok()?;
    let record = reader(&text).into_records().nth(usize::try_from(row).ok()?)?.ok()?;
    let line = line_of(&text, begins(&text, record.position()));
    Some(format!("  row of the {what}: {}:{line}:1\n", shown(file)))
}

/// The rows of a table, each with the byte position in `text` at which the reader began to read the row.
fn placed_rows<'r>(
    reader: &'r mut csv::Reader<&[u8]>,
    text: &'r [u8],
) -> impl Iterator<Item = (usize, csv::Result<csv::StringRecord>)> {
    reader.records().map(|record| {
        let position = match &record {
            Ok(record) => record.position(),
            Err(error) => error.position(),
        };
        (begins(text, position), record)
    })
}

/// The byte position in `text` at which the reader begins to read a row. Blank lines may come between this position and
/// the row.
fn begins(text: &[u8], position: Option<&csv::Position>) -> usize {
    let below = usize::try_from(position.map_or(0, csv::Position::byte)).unwrap_or(0);
    (head_of(text) + below).min(text.len())
}

/// Makes a CSV reader for the text below the comments. In a golden, the comments are its provenance.
fn reader(text: &[u8]) -> csv::Reader<&[u8]> {
    csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(&text[head_of(text)..])
}

fn type_name(scalar: Scalar) -> String {
    Shape::Scalar(scalar).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Result<Table, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("t.csv");
        std::fs::write(&file, text).expect("a file");
        let float = Shape::Scalar(Scalar::F32);
        let vector = Shape::Vector { size: 2, scalar: Scalar::F32 };
        let parameters = [("a".to_owned(), float.clone()), ("v".to_owned(), vector)];
        read(&file, &parameters, &float, Wanted::Near)
            .map_err(|wrong| format!("{} {:?}", wrong.message, wrong.place))
    }

    #[test]
    fn columns_of_another_type_are_errors() {
        for (head, column) in [
            ("a,v.x,v.y,v.z,result", "v.z"),
            ("a,v.x,v.y,v,result", "v"),
            ("a,v.x,v.y,result,result.x", "result.x"),
        ] {
            let error = of(&format!("{head}\n1,2,3,4,5\n")).expect_err("another type");
            assert!(
                error.contains(&format!("has a column `{column}`, which isn't a part of")),
                "{error}"
            );
        }
        of("a,v.x,v.y,result,note,vx\n1,2,3,4,5,6\n").expect("other columns are notes");
    }

    #[test]
    fn columns_come_in_any_order() {
        let table = of("v.y, result, a, v.x\n2, 0.1, 1, 3\n").expect("a valid table");
        let words = [1.0_f32, 3.0, 2.0].map(f32::to_bits).to_vec();
        assert_eq!(
            (table.rows[0].clone(), table.expected[&words].clone()),
            (words, vec![f64::from(0.1_f32)])
        );
    }

    #[test]
    fn a_row_has_its_line() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("t.csv");
        std::fs::write(&file, "# facts\nx,result\n1,2\n\n3,4\n").expect("a file");
        let line = |row| Some(told("row", &file, row)?.rsplit(':').nth(1)?.to_owned());
        assert_eq!([0, 1, 2].map(line), [Some("3".to_owned()), Some("5".to_owned()), None]);
    }

    #[test]
    fn elements_are_numbers_that_the_resource_holds() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("t.csv");
        let of = |text: &str, scalar| {
            std::fs::write(&file, text).expect("a file");
            elements(&file, &Shape::Scalar(scalar), Wanted::Equal)
        };
        assert_eq!(of("value\n1\n2\n", Scalar::U32).expect("a valid table"), [1.0, 2.0]);
        for (text, scalar) in [
            ("value\n1\n\n5.5\n", Scalar::U32),
            ("value\n1\n\nnan\n", Scalar::F32),
            ("value\n1\n\nx\n", Scalar::F32),
        ] {
            let wrong = of(text, scalar).expect_err("no value can equal it");
            assert!(wrong.place.is_some_and(|place| place.ends_with(":4:1")), "{text}");
        }
    }

    // Lesson 194
    #[test]
    fn a_malformed_table_is_an_error() {
        for (text, part) in [
            ("a,v.x,v.y,result\n", "has no row"),
            ("a,v.x,v.y\n1,2,3\n", "has no column `result`"),
            ("a,v.x,v.y,resul\n1,2,3,4\n", "has no column `result` (did you mean `resul`?)"),
            ("a,v.x,v.y,result\n1,2,x,4\n", "column `v.y`: `x` isn't of type f32"),
            ("a,v.x,v.y,result\n1,2,x,4\n", "t.csv:2:1"),
            ("a,v.x,v.y,result\n1,2,3,nan\n", "`nan` isn't a finite number, and Karat compares"),
            (
                "a,v.x,v.y,result\n1,2,3,4\n1,2,3,5\n",
                "a row above has the same arguments, but a different result",
            ),
            ("a,v.x,v.y,result\n1,2,3\n", "CSV error"),
            ("a,v.x,v.y,result\n\n1,2,3\n", "t.csv:3:1"),
            ("a,v.x,v.y,result,result\n1,2,3,4,5\n", "two columns `result`"),
            ("# a\na,v.x,v.y,result\n1,2,3,4\n\n#2,2,3,4\n", "this row begins with `#`"),
            ("# a\na,v.x,v.y,result\n1,2,3,4\n\n#2,2,3,4\n", "t.csv:5:1"),
            ("note,a,v.x,v.y,result\n1,1,2,3,4\n#ff8000,1,2,3,5\n", "quote its first cell"),
            ("a,v.x,v.y,result\n1,2,3,4\n# why\n", "t.csv:3:1"),
        ] {
            let error = of(text).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
