//! A case as a script that hands itself to the page: `karat.receive({...})`.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use half::f16;
use serde_json::{Value, json};

use super::{Case, Map, Part, Rows, facts};
use karat::Image;
use karat::golden::{ChangedRow, Criterion, CriterionMargin, Pending};

/// The whole script. Its text has neither `<` nor line separators, so it could be embedded, too.
pub(super) fn script(index: usize, pending: &Pending, case: &Case) -> String {
    let side = |image: &Option<Image>| image.as_ref().map_or(Value::Null, pixels);
    let part = |Part { name, golden, actual }: &Part| json!({ "name": name, "golden": side(golden), "actual": side(actual) });
    let map = |Map { name, about, image, range }: &Map| json!({ "name": name, "about": about, "range": range, "image": pixels(image) });
    let data = json!({
        "index": index,
        "name": case.name,
        "parts": case.parts.iter().map(part).collect::<Vec<_>>(),
        "maps": case.maps.iter().map(map).collect::<Vec<_>>(),
        "table": case.table.as_ref().map(table),
        "gates": case.margins.iter().map(gate).collect::<Vec<_>>(),
        "verdict": case.verdict,
        "cause": case.cause.to_string(),
        "pixels": case.actual_provenance.pixels,
        "accepting": {
            "canonical": pending.is_canonical(),
            "new": pending.is_new(),
            "own": !pending.provenance.compared_profile.is_empty(),
            "profile": pending.profile().to_string(),
        },
        "facts": facts::table(case.golden_provenance.as_ref(), &case.actual_provenance),
    });
    received(&data)
}

/// The rows of a table that differ. JSON has no infinity, which is what a row has that is new or gone.
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

/// A script that says why there is no data.
pub(super) fn failure(index: usize, error: &str) -> String {
    received(&json!({ "index": index, "error": error }))
}

fn received(data: &Value) -> String {
    format!("karat.receive({});\n", embedded(data))
}

/// JSON has neither NaN nor infinity, so they are words, and whether it passes is said here. The
/// corners of its place are inclusive.
fn gate(margin: &CriterionMargin) -> Value {
    let CriterionMargin { name, value, bound, note, .. } = margin;
    let corners = margin.place.map(|place| {
        let (right, bottom) = (place.left + place.width.max(1), place.top + place.height.max(1));
        [place.left, place.top, right - 1, bottom - 1]
    });
    let value = if value.is_finite() { json!(value) } else { json!(value.to_string()) };
    // A gate's value is over its bound already.
    let ratio = margin.criterion == Criterion::Gate;
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

/// JSON that can stand in a script or in HTML.
pub(super) fn embedded(value: &Value) -> String {
    let text = value.to_string();
    text.replace('<', "\\u003c").replace('\u{2028}', "\\u2028").replace('\u{2029}', "\\u2029")
}

/// Size and values, rows from the top, little-endian: 16-bit floats where they hold every value.
fn pixels(image: &Image) -> Value {
    let values = image.pixels().iter().flatten();
    let fits = |value: &f32| f16::from_f32(*value).to_f32().to_bits() == value.to_bits();
    let (format, bytes): (_, Vec<u8>) = if values.clone().all(fits) {
        ("f16", values.flat_map(|value| f16::from_f32(*value).to_le_bytes()).collect())
    } else {
        ("f32", values.flat_map(|value| value.to_le_bytes()).collect())
    };
    json!({
        "width": image.width(),
        "height": image.height(),
        "format": format,
        "data": STANDARD.encode(bytes),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_format_that_holds_every_value_is_taken() {
        let format =
            |value| pixels(&Image::new(1, 1, vec![[value, 0.0, -0.0, 1.0]]))["format"].clone();
        assert_eq!(format(0.5), "f16");
        assert_eq!(format(f32::INFINITY), "f16");
        assert_eq!(format(0.1), "f32");
        assert_eq!(format(1e6), "f32");
        let one = pixels(&Image::new(1, 1, vec![[1.0, 2.0, 0.0, 1.0]]));
        assert_eq!(one["data"], "ADwAQAAAADw=");
    }

    #[test]
    fn what_is_embedded_ends_no_script() {
        let text = embedded(&json!({ "name": "</script>\u{2028}" }));
        assert_eq!(text, r#"{"name":"\u003c/script>\u2028"}"#);
    }
}
