//! Scripts that pass the data of one frame, golden or failing function to the page: `karat.receive({...})`.

use serde_json::{Value, json};

use super::{Case, Failure, MOST_ROWS, Map, Part, Rows, facts, packed};
use karat::Image;
use karat::unstable::golden::{ChangedRow, Column, Provenance, Table};
use karat::unstable::golden::{CriterionMargin, FrameCriterion};
use karat::unstable::image::ExrFile;
use karat::unstable::metric::DEFAULT_RELATIVE;
use karat::unstable::value::format_lane;

/// Returns the script of a pending frame. The script's text has no `<` and no line separators, so that a page can also
/// embed it.
pub(super) fn script(index: usize, case: &Case, history: &Value) -> String {
    let part = |Part { name, golden, actual }: &Part| {
        let golden = golden.as_ref();
        json!({
            "name": name,
            "golden": golden.map(|golden| packed::image(golden, None)),
            "actual": actual.as_ref().map(|actual| packed::image(actual, golden)),
        })
    };
    let map = |Map { name, about, image, range }: &Map| json!({ "name": name, "about": about, "range": range, "image": packed::map(image) });
    let data = json!({
        "index": index,
        "name": case.name,
        "parts": case.parts.iter().map(part).collect::<Vec<_>>(),
        "maps": case.maps.iter().map(map).collect::<Vec<_>>(),
        "table": case.table.as_ref().map(table),
        "gates": case.margins.iter().map(gate).collect::<Vec<_>>(),
        "gate": bounds(&case.margins),
        "verdict": case.verdict,
        "cause": case.cause.to_string(),
        "pixels": case.actual_provenance.pixels,
        "declared": facts::declared(case.golden_provenance.as_ref(), &case.actual_provenance),
        "versions": history["versions"],
        "modules": history["modules"],
        "told": history["told"],
        "golden_pixels": case.golden_provenance.as_ref().map(|known| &known.pixels),
        "facts": facts::table(case.golden_provenance.as_ref(), &case.actual_provenance),
    });
    received(&data)
}

/// Returns the script of a golden without a pending frame. The script has the golden's images and the list of its
/// versions.
pub(super) fn golden(index: usize, name: &str, golden: &ExrFile, versions: &[Value]) -> String {
    let provenance = golden.metadata.as_deref().map(Provenance::parse);
    let (facts, verdict) = match &provenance {
        Some(Ok(known)) => (facts::table(None, known), format!("accepted: {}", known.because)),
        Some(Err(error)) => (Vec::new(), error.to_string()),
        None => (Vec::new(), "the golden has no provenance".to_owned()),
    };
    let part = |part: &karat::unstable::image::Part| json!({ "name": part.name, "golden": packed::image(&part.image, None), "actual": null });
    received(&json!({
        "index": index,
        "name": name,
        "parts": golden.parts.iter().map(part).collect::<Vec<_>>(),
        "maps": [],
        "gates": [],
        "verdict": verdict,
        "cause": "accepted golden",
        "pixels": "",
        "size": golden.parts.first().map(|part| [part.image.width(), part.image.height()]),
        "versions": versions,
        "golden_pixels": provenance.and_then(Result::ok).map(|known| known.pixels),
        "facts": facts,
    }))
}

/// Returns the script of a golden table for which no new values are pending. The script has the rows and the versions
/// of the golden.
pub(super) fn golden_table(
    index: usize,
    name: &str,
    (table, known): &(Table, Provenance),
    versions: &[Value],
) -> String {
    let row = |(row, (given, results)): (usize, (&[u32], &[u32]))| {
        let shown = |columns: &[Column], words: &[u32]| {
            let cells = columns.iter().zip(words);
            cells.map(|(column, word)| format_lane(column.scalar, *word)).collect::<Vec<_>>()
        };
        let (arguments, others) = table.columns.split_at(given.len());
        json!({ "row": row + 1, "arguments": shown(arguments, given), "golden": shown(others, results) })
    };
    let rows = table.split_rows().enumerate().take(MOST_ROWS).map(row);
    let columns: Vec<&str> = table.columns.iter().map(|column| column.name.as_str()).collect();
    received(&json!({
        "index": index,
        "name": name,
        "parts": [],
        "maps": [],
        "gates": [],
        "table": {
            "accepted": true,
            "columns": columns,
            "arguments": table.arguments,
            "changed": table.len(),
            "rows": rows.collect::<Vec<_>>(),
        },
        "verdict": format!("accepted: {}", known.because),
        "cause": "accepted golden",
        "pixels": "",
        "size": [table.columns.len(), table.len()],
        "versions": versions,
        "golden_pixels": known.pixels,
        "facts": facts::table(None, known),
    }))
}

/// Returns the script of an older version of a golden, at a commit.
pub(super) fn version(index: usize, commit: &str, older: Result<Older, String>) -> String {
    let (key, stored) = match older {
        Ok(Older::Image(image)) => ("image", packed::image(&image, None)),
        Ok(Older::Table(rows)) => ("table", table(&rows)),
        Err(error) => ("why", json!(error)),
    };
    received(&json!({ "index": index, "version": commit, key: stored }))
}

/// The content of an older version of a golden.
pub(super) enum Older {
    Image(Image),
    /// The rows of a table that have changed since the older version.
    Table(Rows),
}

/// Returns the script of a failing function.
pub(super) fn function(index: usize, failure: &Failure) -> String {
    let mut data = failure.value();
    data["index"] = index.into();
    data["function"] = true.into();
    received(&data)
}

/// Returns the changed rows of a table, beside the golden's values. A new or deleted row has an infinite difference,
/// which becomes null, because JSON has no infinity.
fn table(rows: &Rows) -> Value {
    let row = |row: &ChangedRow| {
        json!({
            "row": row.row + 1,
            "arguments": row.arguments,
            "golden": row.golden,
            "actual": row.actual,
            "relative": row.relative.is_finite().then_some(row.relative),
        })
    };
    json!({
        "columns": rows.columns,
        "arguments": rows.arguments,
        "changed": rows.changed,
        "rows": rows.rows.iter().map(row).collect::<Vec<_>>(),
    })
}

/// Returns a script with the reason why there is no data.
pub(super) fn failure(index: usize, error: &str) -> String {
    received(&json!({ "index": index, "error": error }))
}

fn received(data: &Value) -> String {
    format!("karat.receive({});\n", embedded(data))
}

/// Returns a measurement of the test, with its bound, as JSON. NaN and infinity become strings, because JSON has
/// neither. Because the page can't compare these strings with the bound, Rust computes `passes`. `place` is a rectangle
/// of pixels: the left, top, right and bottom coordinate, all inclusive.
fn gate(margin: &CriterionMargin) -> Value {
    let CriterionMargin { name, value, bound, note, .. } = margin;
    let corners = margin.place.map(|place| {
        let (right, bottom) = (place.left + place.width.max(1), place.top + place.height.max(1));
        [place.left, place.top, right - 1, bottom - 1]
    });
    let value = if value.is_finite() { json!(value) } else { json!(value.to_string()) };
    // The value of a gate already is a ratio to its bound.
    let ratio = margin.criterion == FrameCriterion::Gate;
    json!({
        "name": name,
        "ratio": ratio,
        "value": value,
        "bound": bound,
        "note": note,
        "place": corners,
        "passes": margin.passes(),
    })
}

/// Returns the bounds of the gate: the bounds that the test sets, or the default bounds. The page needs the bounds to
/// find the pixels that the gate rejected. A [`CriterionMargin`] has these bounds only in its name: `gate rel 1e-3 or
/// abs 1e-5`.
fn bounds(margins: &[CriterionMargin]) -> Value {
    let gate = margins.iter().find(|margin| margin.criterion == FrameCriterion::Gate);
    let bound = |word: &str| {
        let mut words = gate?.name.split(' ');
        words.find(|other| *other == word)?;
        words.next()?.parse::<f32>().ok().filter(|bound| bound.is_finite())
    };
    json!({ "relative": bound("rel").unwrap_or(DEFAULT_RELATIVE), "absolute": bound("abs") })
}

/// Returns JSON that is safe in a script or in HTML.
pub(super) fn embedded(value: &Value) -> String {
    let text = value.to_string();
    text.replace('<', "\\u003c").replace('\u{2028}', "\\u2028").replace('\u{2029}', "\\u2029")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn embedded_data_ends_no_script() {
        let text = embedded(&json!({ "name": "</script>\u{2028}" }));
        assert_eq!(text, r#"{"name":"\u003c/script>\u2028"}"#);
    }
}
