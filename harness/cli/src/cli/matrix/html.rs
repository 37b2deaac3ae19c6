//! The matrix as one HTML file that needs no other files.

use std::collections::BTreeMap;
use std::io::Write;

use anyhow::Context;
use base64::Engine;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use karat_inspect::matrix::{Cell, Matrix, Row};
use serde_json::{Value, json};

const HTML: &str = include_str!("page/page.html");
const CSS: &str = include_str!("page/page.css");

/// The scripts in the order in which they load. A script may use only earlier scripts while it loads. The page joins
/// all scripts into one script with one scope.
const SCRIPTS: [&str; 14] = [
    include_str!("page/elements.js"),
    include_str!("page/data.js"),
    include_str!("page/words.js"),
    include_str!("page/model.js"),
    include_str!("page/address.js"),
    include_str!("page/shown.js"),
    include_str!("page/table.js"),
    include_str!("page/summary.js"),
    include_str!("page/reasons.js"),
    include_str!("page/tools.js"),
    include_str!("page/panel.js"),
    include_str!("page/draw.js"),
    include_str!("page/keys.js"),
    include_str!("page/main.js"),
];

/// Returns the page. Its data is compressed, because many translations have parts in common.
pub(super) fn page(matrices: &[Matrix]) -> anyhow::Result<String> {
    let data = json!({ "matrices": matrices.iter().map(matrix).collect::<Vec<_>>() });
    let mut deflated = ZlibEncoder::new(Vec::new(), Compression::default());
    deflated
        .write_all(data.to_string().as_bytes())
        .and_then(|()| deflated.try_finish())
        .context("can't compress the page")?;
    let data = base64::engine::general_purpose::STANDARD
        .encode(deflated.finish().context("can't compress the page")?);
    let script = SCRIPTS.join("\n");
    let mut page = String::with_capacity(HTML.len() + CSS.len() + script.len() + data.len());
    for (position, piece) in HTML.split("{{").enumerate() {
        let Some((mark, rest)) = piece.split_once("}}").filter(|_| position > 0) else {
            page.push_str(piece);
            continue;
        };
        page.push_str(match mark {
            "css" => CSS,
            "encoding" => " data-encoding=\"deflate\"",
            "data" => &data,
            "js" => &script,
            _ => unreachable!("`page.html` has no other mark"),
        });
        page.push_str(rest);
    }
    Ok(page)
}

/// Returns the data of a matrix for the page. A translation that several columns share occurs only once in the data.
fn matrix(matrix: &Matrix) -> Value {
    let mut texts = Texts::default();
    let rows: Vec<Value> = matrix.rows.iter().map(|one| row(one, &mut texts)).collect();
    json!({
        "package": matrix.package,
        "naga": matrix.naga,
        "cases": matrix.cases,
        "validators": matrix.validators,
        "columns": matrix.columns,
        "rows": rows,
        "texts": texts.all,
    })
}

/// A list of strings without duplicates.
#[derive(Default)]
struct Texts {
    all: Vec<String>,
    known: BTreeMap<String, usize>,
}

impl Texts {
    fn index(&mut self, text: &str) -> usize {
        if let Some(index) = self.known.get(text) {
            return *index;
        }
        self.all.push(text.to_owned());
        self.known.insert(text.to_owned(), self.all.len() - 1);
        self.all.len() - 1
    }
}

fn row(row: &Row, texts: &mut Texts) -> Value {
    json!({
        "name": row.name,
        "kind": row.kind,
        "location": row.location,
        "error": row.error,
        "source": row.source,
        "cells": row.cells.iter().map(|one| cell(one, texts)).collect::<Vec<_>>(),
    })
}

fn cell(cell: &Cell, texts: &mut Texts) -> Value {
    let reference = cell.reference.as_ref().map(|reference| {
        json!({
            "passed": reference.failed.is_empty(),
            "checks": reference.checks,
            "worst": reference.worst,
        })
    });
    json!({
        "status": cell.status,
        "stopped": cell.stopped,
        "options": cell.options,
        "validators": cell.validators,
        "compared": cell.compared,
        "differing": cell.differing,
        "open": cell.open,
        "worst_ulp": cell.worst_ulp,
        "text": cell.text().map(|text| texts.index(text)),
        "text_lines": cell.text_lines,
        "known": cell.fails_as_declared().map(|known| &known.reason),
        "reference": reference,
        "divergence": cell.divergence,
        "allowed": cell.allowed,
    })
}
