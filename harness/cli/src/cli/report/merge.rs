//! Functions that merge the records of several parts of a run.

use std::cmp::Reverse;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use karat::unstable::output::counted;
use karat::unstable::record::{Record, Recorded, Run, SCHEMA, Verdict};

/// Merges the verdicts of the parts of a run. The order of the result doesn't depend on the order of the parts. If a
/// check ran in several parts, the check gets the worst of its verdicts. The merged run has ended if all parts have
/// ended, and has passed if all parts have passed.
pub(super) fn merged(parts: &[Recorded]) -> Recorded {
    let folders: Vec<String> = parts.iter().map(|part| part.folder.display().to_string()).collect();
    let run = parts.iter().map(|part| part.run.clone()).collect::<Option<Vec<Run>>>();
    let sorted = |all: Vec<String>| all.into_iter().collect::<BTreeSet<_>>().into_iter().collect();
    let run = run.map(|runs| Run {
        schema: SCHEMA,
        selected: sorted(runs.iter().flat_map(|run| run.selected.clone()).collect()),
        passed: runs.iter().all(|run| run.passed),
        failed: sorted(runs.iter().flat_map(|run| run.failed.clone()).collect()),
        invalid: sorted(runs.iter().flat_map(|run| run.invalid.clone()).collect()),
        errors: runs
            .iter()
            .flat_map(|run| run.errors.clone())
            .collect::<BTreeSet<_>>()
            .into_iter()
            .collect(),
        invalid_packages: sorted(
            runs.iter().flat_map(|run| run.invalid_packages.clone()).collect(),
        ),
        remarks: sorted(runs.iter().flat_map(|run| run.remarks.clone()).collect()),
        // The messages of the parts contain the reason.
        not_run: 0,
        stopped: false,
    });
    // The merged records, and the index of each check among them.
    let (mut records, mut places) = (Vec::<Record>::new(), BTreeMap::<String, usize>::new());
    for part in parts {
        // A test may make the same check several times. These checks stay separate.
        let mut seen = BTreeMap::<String, usize>::new();
        for record in &part.records {
            let key = key(record);
            let count = seen.entry(key.clone()).or_default();
            *count += 1;
            let place = *places.entry(format!("{key} {count}")).or_insert(records.len());
            match records.get_mut(place) {
                None => records.push(record.clone()),
                Some(known) if rank(record) > rank(known) => *known = record.clone(),
                Some(_) => {}
            }
        }
    }
    Record::sort(&mut records);
    Recorded { folder: PathBuf::from(folders.join(", ")), records, run }
}

/// Returns a sentence for each part that lacks tests, or may lack tests, because its runner stopped after a failure.
pub(super) fn missing(parts: &[Recorded]) -> Vec<String> {
    let of = |part: &Recorded| {
        let (folder, run) = (part.folder.display(), part.run.as_ref()?);
        let checks = counted(part.records.len(), "check");
        match (run.not_run, run.stopped) {
            (0, false) => None,
            (0, true) => Some(format!(
                "`{folder}` has {checks}, and may lack other checks, because its runner stopped at a failure (run with --no-fail-fast)"
            )),
            (tests, _) => {
                let tests = counted(tests, "test");
                Some(format!(
                    "`{folder}` has {checks}, and lacks {tests} that didn't run after a failure (run with --no-fail-fast)"
                ))
            }
        }
    };
    parts.iter().filter_map(of).collect()
}

/// Merges the records of the same check on several paths.
pub(in crate::cli) fn side_by_side(records: Vec<Record>) -> Vec<Record> {
    let mut checks: BTreeMap<String, Record> = BTreeMap::new();
    // A test may make the same check several times. The order of these checks is the same on each path.
    let mut seen: BTreeMap<(String, String), u32> = BTreeMap::new();
    for record in records {
        let paths: Vec<&str> = record.paths.iter().map(|path| &*path.adapter.path).collect();
        let key = key(&record);
        let count = seen.entry((key.clone(), paths.join(","))).or_default();
        *count += 1;
        match checks.entry(format!("{key} {count}")) {
            Entry::Vacant(vacant) => {
                vacant.insert(record);
            }
            Entry::Occupied(mut known) => {
                let known = known.get_mut();
                known.paths.extend(record.paths);
                if severity(record.verdict) > severity(known.verdict) {
                    known.verdict = record.verdict;
                }
                let messages: Vec<String> =
                    [known.message.take(), record.message].into_iter().flatten().collect();
                known.message = (!messages.is_empty()).then(|| messages.join("\n"));
                match (&mut known.details, record.details) {
                    (Some(known), Some(own)) => known.paths.extend(own.paths),
                    (known, own) => *known = known.take().or(own),
                }
            }
        }
    }
    let mut records: Vec<Record> = checks.into_values().collect();
    Record::sort(&mut records);
    records
}

/// Returns the rank of a record. A worse verdict has a higher rank. Of two equal verdicts, the earlier one has the
/// higher rank.
fn rank(record: &Record) -> (u8, Reverse<Option<&str>>) {
    let started = record.time.as_ref().map(|time| &*time.started);
    (severity(record.verdict), Reverse(started))
}

/// Returns a key that is the same for records of the same check, in the same test, with the same overlay.
fn key(record: &Record) -> String {
    let subject = serde_json::to_string(&record.subject).expect("a subject is plain data");
    format!("{subject} {} {:?}", record.test, record.overlay)
}

fn severity(verdict: Verdict) -> u8 {
    match verdict {
        Verdict::Pass => 0,
        Verdict::KnownIssue => 1,
        Verdict::Fail => 2,
        Verdict::Error => 3,
    }
}
