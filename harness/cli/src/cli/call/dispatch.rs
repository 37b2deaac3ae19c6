//! `karat call --dispatch`: dispatches a compute entry point, and prints the results.

use std::io::Write;

use anyhow::ensure;
use karat::Path;
use karat::compute::Compute;
use karat::unstable::compute::{Content, left, printed, violations};

use super::super::table::{BAD, DIM, HEAD, KNOWN};
use super::super::{Ending, Outcome};

/// The largest number of elements of an array that Karat prints.
const SHOWN: usize = 16;

/// Parses numbers of workgroups: `4`, `4,2` or `4,2,1`. Missing numbers are 1.
pub(super) fn workgroups(text: &str) -> Result<[u32; 3], String> {
    let groups = numbers(text, 1);
    // The largest number is WebGPU's `maxComputeWorkgroupsPerDimension` (section 3.6.2).
    let groups = groups.filter(|all| all.iter().all(|count| (1..=65_535).contains(count)));
    groups.ok_or_else(|| "write the workgroups as 4 or 4,2,1, each from 1 to 65535".to_owned())
}

/// Parses the `global_invocation_id` of an invocation: `3`, `3,0` or `3,0,0`. Missing numbers are 0.
pub(super) fn invocation(text: &str) -> Result<[u32; 3], String> {
    let wrong = "write the `global_invocation_id` of an invocation as 3 or 3,0,0";
    numbers(text, 0).ok_or_else(|| wrong.to_owned())
}

/// Parses one to three numbers. Missing numbers become `others`.
fn numbers(text: &str, others: u32) -> Option<[u32; 3]> {
    let all: Result<Vec<u32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match all.as_deref() {
        Ok(&[x]) => Some([x, others, others]),
        Ok(&[x, y]) => Some([x, y, others]),
        Ok(&[x, y, z]) => Some([x, y, z]),
        _ => None,
    }
}

/// Checks the pass with the sanitizer, dispatches the pass on each path, and prints the results.
pub(super) fn run(compute: &Compute<'_>, paths: &[Path], out: &mut dyn Write) -> Outcome {
    let (found, watched) = violations(compute)?;
    let mut first: Vec<Content> = Vec::new();
    let mut unlike: Vec<String> = Vec::new();
    let mut stopped = Vec::new();
    for path in paths {
        let all = match left(compute, *path) {
            Ok(all) => all,
            Err(error) => {
                let error = error.to_string();
                stopped.push(format!(
                    "path `{path}` returned no result: {}",
                    error.trim_start_matches("error: ")
                ));
                continue;
            }
        };
        for content in &all {
            writeln!(out, "{HEAD}{path:<8}{HEAD:#} {} = {}", content.name, shown(content))?;
            let other = first.iter().find(|other| other.name == content.name);
            if other.is_some_and(|other| differ(other, content)) && !unlike.contains(&content.name)
            {
                unlike.push(content.name.clone());
            }
        }
        if first.is_empty() {
            first = all;
        }
    }
    let fails = found.iter().any(|(one, _)| one.kind.fails());
    for name in unlike {
        let why = match fails {
            true => "the problem below may cause this difference",
            false => "the results may depend on the order of invocations",
        };
        writeln!(out, "{KNOWN}the values of `{name}` differ between the paths: {why}{KNOWN:#}")?;
    }
    for (one, message) in &found {
        let style = if one.kind.fails() { BAD } else { DIM };
        writeln!(out, "\n{style}{message}{style:#}")?;
    }
    if !watched.reason.is_empty() {
        writeln!(out, "{DIM}the sanitizer didn't check the whole pass: {}{DIM:#}", watched.reason)?;
    }
    for table in printed(compute)? {
        write!(out, "{table}")?;
    }
    ensure!(stopped.is_empty(), "{}", stopped.join("\n"));
    Ok(if fails { Ending::Bad } else { Ending::Good })
}

/// Checks if the contents of a resource on two paths differ in an integer or a boolean. Floats may differ, because
/// drivers round them differently.
fn differ(one: &Content, other: &Content) -> bool {
    let scalars = one.shape.lanes();
    let mut lanes = one.lanes.iter().zip(&other.lanes).zip(&scalars);
    lanes.any(|((one, other), scalar)| one != other && !scalar.is_float())
}

/// Formats the content of a resource. For a long array, formats only the first elements.
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

#[cfg(test)]
mod tests {
    use karat::unstable::value::{Scalar, Shape};

    use super::{Content, differ};

    #[test]
    fn floats_are_rounded_and_whole_numbers_are_not() {
        let content = |scalar: Scalar, word: u32| Content {
            name: "bins".to_owned(),
            shape: Shape::Scalar(scalar),
            lanes: vec![word],
        };
        let of = |scalar, a, b| differ(&content(scalar, a), &content(scalar, b));
        assert!(of(Scalar::U32, 1, 2) && of(Scalar::I32, 1, 2) && !of(Scalar::U32, 2, 2));
        assert!(!of(Scalar::F32, 1.0_f32.to_bits(), 1.5_f32.to_bits()));
    }
}
