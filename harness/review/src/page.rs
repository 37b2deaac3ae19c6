//! The page: one HTML file with its style, its scripts and a list of frames, goldens and failing functions.

use serde_json::{Value, json};

use super::data::embedded;
use super::{Entry, FrameRun, Review, golden_name};
use karat::unstable::diagnostic::shown;
use karat::unstable::golden::{CriterionMargin, FrameCriterion};
use karat::unstable::golden::{Pending, PendingFrames};

const HTML: &str = include_str!("page/page.html");
const CSS: &str = include_str!("page/page.css");

/// The scripts, in the order in which the page joins them into one script with one scope. Top-level code uses only
/// earlier scripts.
const SCRIPTS: [&str; 26] = [
    include_str!("page/numbers.js"),
    include_str!("page/tones.js"),
    include_str!("page/shader.js"),
    include_str!("page/state.js"),
    include_str!("page/gain.js"),
    include_str!("page/failing.js"),
    include_str!("page/stage.js"),
    include_str!("page/overlay.js"),
    include_str!("page/pointer.js"),
    include_str!("page/values.js"),
    include_str!("page/histogram.js"),
    include_str!("page/inspector.js"),
    include_str!("page/pixel.js"),
    include_str!("page/facts.js"),
    include_str!("page/table.js"),
    include_str!("page/origin.js"),
    include_str!("page/function.js"),
    include_str!("page/controls.js"),
    include_str!("page/choose.js"),
    include_str!("page/thumbs.js"),
    include_str!("page/versions.js"),
    include_str!("page/cases.js"),
    include_str!("page/sheet.js"),
    include_str!("page/decide.js"),
    include_str!("page/address.js"),
    include_str!("page/main.js"),
];

/// The source from which the browser loads the page.
pub(super) enum Mode {
    /// From files. The user accepts and rejects frames in a terminal.
    Files,
    /// From Karat's server. The nonce in the page's security policy is a hash of the page's data. These data include
    /// the secret token, so the nonce is secret, too.
    Served {
        /// The token in the URL.
        token: String,
    },
}

/// Returns the page for pending frames and other entries. Each entry has the number of its data file.
pub(super) fn html(
    review: &Review,
    pending: &PendingFrames,
    numbered: &[(usize, Entry)],
    mode: &Mode,
) -> String {
    let arguments = review.arguments.as_str();
    let token = match mode {
        Mode::Files => "",
        Mode::Served { token } => token,
    };
    let arguments = if arguments.is_empty() { String::new() } else { format!(" {arguments}") };
    let entry = |(number, entry): &(usize, Entry)| match entry {
        Entry::Pending(name) => {
            let frame = pending.frames.iter().find(|frame| frame.case == *name)?;
            Some(json!({
                "index": number,
                "name": frame.case,
                "status": "pending",
                "new": frame.is_new(),
                "table": frame.is_table(),
                "size": [frame.provenance.width, frame.provenance.height],
                "pixels": frame.provenance.pixels,
                "severity": severity(frame),
                "finite": is_finite(frame),
                "accepting": accepting(frame),
                "test": review.run.frames.get(name).map(FrameRun::value),
                "accept": format!("{}{arguments}", frame.accept_arguments()),
            }))
        }
        Entry::Golden(file) => {
            let (name, table) = golden_name(file);
            Some(json!({ "index": number, "name": name, "status": "golden", "table": table }))
        }
        Entry::Failure(at) => {
            let failure = review.run.failures.get(*at)?;
            let severity = failure.ratio.map_or(json!("inf"), |ratio| json!(ratio));
            Some(json!({
                "index": number, "name": failure.name, "status": "function", "severity": severity,
            }))
        }
    };
    let frames = numbered.iter().filter_map(entry);
    let unusable = pending.unusable.iter().map(
        |unusable| json!({ "name": shown(&unusable.path), "error": unusable.reason.to_string() }),
    );
    let index = embedded(&json!({
        "served": !token.is_empty(), "pixels": !token.is_empty() && review.asked.pixels.is_some(),
        "arguments": arguments,
        "cases": frames.collect::<Vec<_>>(),
        "unusable": unusable.collect::<Vec<_>>(),
    }));
    let script = SCRIPTS.join("\n");
    // Inline style and scripts run because the policy names this nonce. The nonce depends on all embedded data, so no
    // name or reason can contain it.
    let nonce =
        blake3::hash(format!("{token}{index}{script}").as_bytes()).to_hex()[..32].to_owned();
    // One loop replaces all placeholders, so that it doesn't search inserted text for placeholders.
    let mut page = String::with_capacity(HTML.len() + CSS.len() + script.len() + index.len());
    for (position, piece) in HTML.split("{{").enumerate() {
        let Some((mark, rest)) = piece.split_once("}}").filter(|_| position > 0) else {
            page.push_str(piece);
            continue;
        };
        page.push_str(
            match mark {
                "policy" => policy(mode),
                "nonce" => &nonce,
                "css" => CSS,
                "index" => &index,
                "script" => &script,
                other => unreachable!("page.html has no mark `{other}`"),
            }
            .replace("NONCE", &nonce)
            .as_str(),
        );
        page.push_str(rest);
    }
    page
}

/// Returns the largest ratio (an error divided by its bound) of the frame's failing measurements. The ratio is `inf` if
/// the images can't be compared, for example because their sizes differ. Returns `None` if there is no golden.
fn severity(frame: &Pending) -> Option<Value> {
    let finding = frame.provenance.finding.as_ref()?;
    let failing = finding.margins.iter().filter(|margin| !margin.passes());
    let most = failing.map(CriterionMargin::ratio).fold(0.0, f64::max);
    let measured = most > 0.0 && most.is_finite();
    Some(if measured { json!(most) } else { json!("inf") })
}

/// Checks that the test found no NaN and no infinity in the frame.
fn is_finite(frame: &Pending) -> bool {
    let margins = frame.provenance.finding.iter().flat_map(|finding| &finding.margins);
    !margins
        .into_iter()
        .any(|margin| margin.criterion == FrameCriterion::Finite && !margin.passes())
}

/// Returns the properties of a frame from which the page decides if accepting the frame changes the shared golden or
/// the golden of one profile.
fn accepting(frame: &Pending) -> Value {
    json!({
        "canonical": frame.is_canonical(),
        "new": frame.is_new(),
        "own": !frame.provenance.compared_profile.is_empty(),
        "profile": frame.profile().to_string(),
    })
}

/// Returns the sources from which the page may load and run scripts: the page and its data files. For a page from
/// files, the sources include `file:`, because some browsers treat neighbouring files as different origins.
fn policy(mode: &Mode) -> &'static str {
    match mode {
        Mode::Files => {
            "default-src 'none'; script-src 'nonce-NONCE' 'self' file:; style-src 'nonce-NONCE'; \
             base-uri 'none'; form-action 'none'"
        }
        Mode::Served { .. } => {
            "default-src 'none'; script-src 'nonce-NONCE' 'self'; style-src 'nonce-NONCE'; \
             connect-src 'self'; base-uri 'none'; form-action 'none'"
        }
    }
}
