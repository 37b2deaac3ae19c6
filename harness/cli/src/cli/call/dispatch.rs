//! `karat call --dispatch`: what a compute pass leaves.

use std::io::Write;

use karat::Path;
use karat::compute::Compute;
use karat::unstable::compute::{Content, left, violations};

use super::super::table::{BAD, DIM, HEAD};
use super::super::{Ending, Outcome};

/// Elements of an array that are shown.
const SHOWN: usize = 16;

/// `4`, `4,2` or `4,2,1`.
pub(super) fn workgroups(text: &str) -> Result<[u32; 3], String> {
    let counts: Result<Vec<u32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let groups = match counts.as_deref() {
        Ok(&[x]) => Some([x, 1, 1]),
        Ok(&[x, y]) => Some([x, y, 1]),
        Ok(&[x, y, z]) => Some([x, y, z]),
        _ => None,
    };
    // WebGPU, 3.6.2: maxComputeWorkgroupsPerDimension.
    let groups = groups.filter(|all| all.iter().all(|count| (1..=65_535).contains(count)));
    groups.ok_or_else(|| "write workgroups as 4, or as 4,2,1; each is from 1 to 65535".to_owned())
}

/// Looks through the passes, dispatches them on each path and prints what they leave.
pub(super) fn run(compute: &Compute<'_>, paths: &[Path], out: &mut dyn Write) -> Outcome {
    let (found, watched) = violations(compute)?;
    for path in paths {
        for content in left(compute, *path)? {
            writeln!(out, "{HEAD}{path:<8}{HEAD:#} {} = {}", content.name, shown(&content))?;
        }
    }
    for (one, message) in &found {
        let style = if one.kind.fails() { BAD } else { DIM };
        writeln!(out, "\n{style}{message}{style:#}")?;
    }
    if !watched.reason.is_empty() {
        writeln!(out, "{DIM}not looked through whole: {}{DIM:#}", watched.reason)?;
    }
    let fails = found.iter().any(|(one, _)| one.kind.fails());
    Ok(if fails { Ending::Bad } else { Ending::Good })
}

/// The content of a resource; of a long array its first elements.
fn shown(content: &Content) -> String {
    let width = content.element().lanes().len().max(1);
    let count = content.lanes.len() / width;
    let elements = content.lanes.chunks_exact(width).map(|one| content.element().format(one));
    if content.shape == *content.element() {
        return content.shape.format(&content.lanes);
    }
    let first: Vec<String> = elements.take(SHOWN).collect();
    match count.saturating_sub(SHOWN) {
        0 => format!("[{}]", first.join(", ")),
        more => format!("[{}, and {more} more]", first.join(", ")),
    }
}
