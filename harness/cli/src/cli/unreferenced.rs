//!
//! `karat unreferenced`: lists goldens that no test compares, and files that belong to no golden.
//!
//! The command needs the record of a complete run that passed. Without this record, the command gives no verdict.

mod facts;
mod files;

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use karat::Image;
use karat::unstable::golden::{Profile, Provenance, Table};
use karat::unstable::output::counted;
use karat::unstable::record::{Record, Recorded, Subject};
use serde::Serialize;

use self::facts::Doubt;
use self::files::{Files, Golden, Stray};
use super::goldens::{CiArgs, FolderArgs};
use super::project::Project;
use super::table::{BAD, DIM, GOOD};
use super::{Ending, NotThere, Outcome, write_json};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Lists the unreferenced goldens, then deletes them with their provenance (`.toml`)
    #[arg(long)]
    delete: bool,
    /// Prints JSON: record, compared, unreferenced {case, profile, file}, unjudged (the same), doubtful {case,
    /// profile, file, problem} (the provenance is missing, or doesn't match the image), stray {file, reason}, deleted (files),
    /// left (unreferenced goldens that --delete kept)
    #[arg(long)]
    json: bool,
    /// Reads the records in this folder [default: the record of the last run]
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    #[command(flatten)]
    ci: CiArgs,
    #[command(flatten)]
    folder: FolderArgs,
}

#[derive(Debug, Serialize)]
struct Report {
    record: String,
    /// The number of goldens that a test compared.
    compared: usize,
    unreferenced: Vec<Golden>,
    /// The goldens of profiles that didn't run.
    unjudged: Vec<Golden>,
    /// The goldens whose provenance is missing or doesn't match the image. Unreferenced goldens aren't in this list.
    doubtful: Vec<Doubt>,
    stray: Vec<Stray>,
    deleted: Vec<PathBuf>,
    /// The unreferenced goldens that `--delete` kept, because they have no provenance.
    left: Vec<PathBuf>,
}

/// The goldens that the tests compared.
struct Evidence {
    frames: BTreeSet<String>,
    /// The folders of compared goldens, without the folder that this command examines.
    elsewhere: BTreeSet<String>,
    profiles: BTreeSet<String>,
    /// The name and the profile of each comparison of a frame with a golden.
    pairs: BTreeSet<(String, String)>,
    /// The files that tests read. Some of them may be goldens of values.
    read: BTreeSet<PathBuf>,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    if args.delete {
        args.ci.check("delete")?;
    }
    let record = match &args.record {
        Some(folder) => folder.clone(),
        None => Project::last_tested()?.record(),
    };
    let (record, records) = whole_run(&record)?;
    let folder = args.folder.path()?;
    let evidence = Evidence::gather(&records, &folder);
    let Files { goldens, stray } = Files::of(&folder)?;
    let shown = folder.display();
    if goldens.is_empty() && stray.is_empty() {
        let why = "so Karat can't judge this folder; name the folder of goldens with --goldens DIR";
        return Err(NotThere(format!("there is no golden in `{shown}`, {why}")).into());
    }
    let none = evidence.frames.is_empty() && evidence.read.is_empty();
    if none && !evidence.elsewhere.is_empty() {
        let elsewhere: Vec<&str> = evidence.elsewhere.iter().map(String::as_str).collect();
        return Err(NotThere(format!(
            "the last run compared no frame with a golden of `{shown}`, only with goldens of `{}`; \
             name the folder that you mean with --goldens DIR",
            elsewhere.join("`, `")
        ))
        .into());
    }
    let mut report = Report {
        record: record.display().to_string(),
        compared: 0,
        unreferenced: Vec::new(),
        unjudged: Vec::new(),
        doubtful: Vec::new(),
        stray,
        deleted: Vec::new(),
        left: Vec::new(),
    };
    for golden in goldens {
        let compared = evidence.has(&golden);
        // An unreferenced golden is to be deleted, so its provenance doesn't matter.
        if compared != Some(false) {
            report.doubtful.extend(Doubt::of(&golden));
        }
        match compared {
            Some(true) => report.compared += 1,
            Some(false) => report.unreferenced.push(golden),
            None => report.unjudged.push(golden),
        }
    }
    if !args.json {
        write(&report, out)?;
        out.flush()?;
    }
    if args.delete {
        ensure!(
            report.compared > 0 || report.unreferenced.is_empty(),
            "the run compared no golden in `{shown}`, so Karat deletes no golden: this may be the \
             wrong folder"
        );
        for file in deletable(&report) {
            std::fs::remove_file(&file)
                .with_context(|| format!("can't delete `{}`", file.display()))?;
            report.deleted.push(file);
        }
        let remains = |golden: &&Golden| !report.deleted.contains(&golden.file);
        report.left = report.unreferenced.iter().filter(remains).map(|g| g.file.clone()).collect();
    }
    if args.json {
        write_json(&report, out)?;
    } else if args.delete {
        write_deleted(&report, out)?;
    }
    Ok(if report.is_good() { Ending::Good } else { Ending::Bad })
}

impl Report {
    /// Checks that no unreferenced golden and no stray file remains, and that each provenance matches its image.
    fn is_good(&self) -> bool {
        let gone = |file: &PathBuf| self.deleted.contains(file);
        self.doubtful.is_empty()
            && self.unreferenced.iter().all(|golden| gone(&golden.file))
            && self.stray.iter().all(|stray| gone(&stray.file))
    }
}

/// Returns the files to delete: unreferenced goldens with their provenance, and stray files that Karat wrote.
fn deletable(report: &Report) -> Vec<PathBuf> {
    let of = |golden: &Golden| match golden.is_table() {
        true => vec![golden.file.clone()],
        false => vec![golden.file.clone(), golden.file.with_extension("toml")],
    };
    let strays = report.stray.iter().filter(|stray| stray.is_ours).map(|stray| stray.file.clone());
    let goldens = report.unreferenced.iter().filter(|golden| is_golden(&golden.file));
    let mut all: Vec<PathBuf> = goldens.flat_map(of).chain(strays).collect();
    all.retain(|file| file.symlink_metadata().is_ok());
    all.sort();
    all.dedup();
    all
}

/// Checks if a file has the provenance of an accepted golden. Without provenance, the file may belong to another tool.
fn is_golden(file: &Path) -> bool {
    if Table::read(file).is_ok() {
        return true;
    }
    let metadata = Image::read_exr(file).ok().and_then(|(_, metadata)| metadata);
    metadata.is_some_and(|text| Provenance::parse(&text).is_ok())
}

fn write_deleted(report: &Report, out: &mut dyn Write) -> std::io::Result<()> {
    for file in &report.left {
        let file = file.display();
        writeln!(
            out,
            "{BAD}not deleted, because this file has no provenance: delete the file \
             yourself, or compare the file in a test{BAD:#}  {file}"
        )?;
    }
    writeln!(out, "deleted {}", counted(report.deleted.len(), "file"))
}

fn write(report: &Report, out: &mut dyn Write) -> std::io::Result<()> {
    for golden in &report.unreferenced {
        writeln!(out, "{BAD}no test compares golden {golden}{BAD:#}  {}", golden.file.display())?;
    }
    for Doubt { golden, problem } in &report.doubtful {
        writeln!(out, "{BAD}{golden}: {problem}; {}{BAD:#}", facts::ADVICE)?;
    }
    for Stray { file, reason, .. } in &report.stray {
        writeln!(out, "{BAD}{reason}{BAD:#}  {}", file.display())?;
    }
    for golden in &report.unjudged {
        writeln!(out, "{DIM}not judged, because the golden's profile didn't run: {golden}{DIM:#}")?;
    }
    let (unreferenced, stray) = (report.unreferenced.len(), report.stray.len());
    let doubtful = match report.doubtful.len() {
        0 => String::new(),
        count => format!(", {count} with wrong or missing provenance"),
    };
    let style = if unreferenced + stray + report.doubtful.len() == 0 { GOOD } else { BAD };
    let (compared, stray) = (counted(report.compared, "golden"), counted(stray, "stray file"));
    writeln!(
        out,
        "{style}{compared} compared, {unreferenced} unreferenced, {stray}{doubtful}{style:#}"
    )
}

/// Returns the records of the last run, or an error if that run skipped tests, failed or used an overlay.
fn whole_run(record: &Path) -> anyhow::Result<(PathBuf, Vec<Record>)> {
    let none = |why: String| NotThere(format!("{why}; run `karat test` without a filter first"));
    let recorded = Recorded::read(record)?;
    let absent = || none(format!("there is no record of a run (`{}`)", record.display()));
    let Recorded { folder, records, run } = recorded.ok_or_else(absent)?;
    let shown = folder.display();
    let run =
        run.ok_or_else(|| none(format!("the record `{shown}` doesn't say that its run ended")))?;
    if !run.selected.is_empty() {
        let selected = run.selected.join(" ");
        return Err(none(format!("the last run ran only some tests (`{selected}`)")).into());
    }
    if let Some(overlay) = records.iter().find_map(|record| record.overlay.as_ref()) {
        return Err(none(format!(
            "in the last run, files of KARAT_OVERLAY={overlay} replaced shaders"
        ))
        .into());
    }
    if !run.passed {
        let why = "a test failed in the last run, so Karat doesn't know which goldens the test would have \
                   compared later; repair the test, or accept its frames";
        return Err(none(why.to_owned()).into());
    }
    Ok((folder, records))
}

impl Evidence {
    /// Collects the goldens that the recorded checks compared. `golden` is the folder that this command examines.
    fn gather(records: &[Record], golden: &Path) -> Self {
        let (mut frames, mut profiles, mut pairs) =
            <(BTreeSet<_>, BTreeSet<_>, BTreeSet<_>)>::default();
        let mut read = BTreeSet::new();
        let mut elsewhere = BTreeSet::new();
        let same = |folder: &str| match (Path::new(folder).canonicalize(), golden.canonicalize()) {
            (Ok(folder), Ok(golden)) => folder == golden,
            _ => false,
        };
        for record in records {
            let ran = record.paths.iter().map(|path| Profile::of(&path.adapter).to_string());
            let ran: BTreeSet<String> = ran.collect();
            match &record.subject {
                Subject::Frame { golden, folder, .. } if same(folder) => {
                    frames.insert(golden.clone());
                    pairs.extend(ran.iter().map(|profile| (golden.clone(), profile.clone())));
                }
                // A frame without a folder was compared with a number.
                Subject::Frame { folder, .. } if !folder.is_empty() => {
                    elsewhere.insert(folder.clone());
                }
                _ => {}
            }
            profiles.extend(ran);
            let files = record.read.iter().map(|read| &read.file);
            let tables = files.filter(|file| file.extension().is_some_and(|end| end == "csv"));
            read.extend(tables.filter_map(|file| file.canonicalize().ok()));
        }
        Self { frames, elsewhere, profiles, pairs, read }
    }

    /// Checks if a test compared a golden. Returns `None` if the profile of the golden didn't run.
    fn has(&self, golden: &Golden) -> Option<bool> {
        if golden.is_table() {
            return Some(golden.file.canonicalize().is_ok_and(|file| self.read.contains(&file)));
        }
        if !self.frames.contains(&golden.case) {
            return Some(false);
        }
        let Some(profile) = &golden.profile else { return Some(true) };
        self.profiles
            .contains(profile)
            .then(|| self.pairs.contains(&(golden.case.clone(), profile.clone())))
    }
}
