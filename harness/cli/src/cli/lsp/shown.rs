//! The diagnostics that the editor shows: errors in modules, and failing tests. After an edit of a file that a test
//! read, the failures of this test are hidden.

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use karat::unstable::record::{Record, Verdict};
use lsp_types::notification::PublishDiagnostics;
use lsp_types::{Diagnostic, PublishDiagnosticsParams};
use serde_json::Value;

use super::super::report::Place;
use super::super::report::merge::side_by_side;
use super::super::report::short::{self, Finding};
use super::documents::Now;
use super::findings::{self, Findings};
use super::place::{self, resolved};
use super::root::{Root, Verdicts};
use super::server::Server;

impl Server {
    /// Sends the present errors and failures to the editor.
    pub(super) fn settle(&mut self) {
        if std::mem::take(&mut self.edited) {
            // A compiler that panics on an incomplete program has no verdict.
            let found = catch_unwind(AssertUnwindSafe(|| self.find_invalid()));
            self.invalid = found.unwrap_or_else(|_| {
                self.client.tell_once("a compiler of WGSL panicked, so Karat shows no errors of modules until the next edit");
                Findings::new()
            });
        } else if !self.judged {
            return;
        }
        self.judged = false;
        let mut findings = self.invalid.clone();
        for root in &self.roots {
            self.find_failures(root, &mut findings);
        }
        self.publish(findings);
        if self.client.can_refresh_lenses {
            self.client.ask("workspace/codeLens/refresh", &Value::Null);
        }
    }

    fn find_invalid(&mut self) -> Findings {
        let mut found = Findings::new();
        for root in &self.roots {
            let (invalid, opinion) = root.invalid(&self.documents);
            for invalid in &invalid {
                for placeless in findings::of_invalid(invalid, &mut found) {
                    self.client.tell_once(&placeless);
                }
            }
            findings::of_opinion(&opinion, &mut found);
        }
        found
    }

    fn find_failures(&self, root: &Root, found: &mut Findings) {
        let now = Now::of(&self.documents);
        let (folder, last) = (root.project.root(), &root.last);
        let Verdicts { current, .. } = self.verdicts(root, &now);
        findings::of_records(&current, last, folder, &self.documents, found);
        for lane in self.live.lanes().filter(|lane| self.is_of(root, &lane.package)) {
            // A failure without a record has no list of files. It counts only for the saved files.
            if self.documents.is_unsaved_below(&lane.package) || lane.resident.busy {
                continue;
            }
            let shows = |record: &Record| {
                short::of(record, folder).iter().any(|finding| finding.place.is_some())
            };
            let shown = |test: &str| {
                lane.verdicts.iter().any(|record| record.test == test && shows(record))
            };
            let failing = lane.resident.failing.iter().filter(|(test, _)| !shown(test));
            for wrong in failing.map(|(_, wrong)| wrong).chain(&lane.broken) {
                // The server already shows the errors of an invalid module, for the text in the editor.
                if let Some(place) = wrong.place.as_deref().and_then(Place::of)
                    && !self.invalid.contains_key(&resolved(Path::new(&place.file)))
                {
                    let file = resolved(Path::new(&place.file)).display().to_string();
                    let place = Some(Place { file, ..place });
                    let finding = Finding { place, message: wrong.headline.clone() };
                    findings::add(finding, None, folder, &self.documents, found);
                }
            }
        }
    }

    fn is_of(&self, root: &Root, package: &Path) -> bool {
        root.packages.iter().any(|known| resolved(&known.root()) == package)
    }

    /// Returns the verdicts of the last runs, merged with the verdicts of the long-lived processes.
    pub(super) fn verdicts(&self, root: &Root, now: &Now<'_>) -> Verdicts {
        let lanes: Vec<_> = self.live.lanes().filter(|l| self.is_of(root, &l.package)).collect();
        let live = root.sorted(lanes.iter().flat_map(|lane| lane.verdicts.iter().cloned()), now);
        let mut all = root.verdicts(now);
        // If a long-lived process runs a test on a path, the process's verdict replaces the recorded one.
        for lane in lanes.iter().filter(|lane| lane.done) {
            all.current
                .retain_mut(|record| !lane.has(&record.test) || leave(record, &lane.resident.path));
        }
        let current = live.current.into_iter().chain(all.current).collect();
        let stale = live.stale.into_iter().chain(all.stale).collect();
        Verdicts { current: side_by_side(current), stale }
    }

    fn publish(&mut self, findings: Findings) {
        let empty: Vec<Diagnostic> = Vec::new();
        let files: BTreeSet<&PathBuf> = self.published.keys().chain(findings.keys()).collect();
        for file in files {
            let diagnostics = findings.get(file).unwrap_or(&empty);
            if self.published.get(file).unwrap_or(&empty) == diagnostics {
                continue;
            }
            let document = self.documents.get(file);
            let uri = document.map(|document| document.uri.clone()).or_else(|| place::uri(file));
            let Some(uri) = uri else { continue };
            let version = document.map(|document| document.version);
            let diagnostics = diagnostics.clone();
            let parameters = PublishDiagnosticsParams { uri, diagnostics, version };
            self.client.notify::<PublishDiagnostics>(&parameters);
        }
        self.published = findings;
    }
}

/// Removes a path from a record. Returns `true` if the record has other paths.
fn leave(record: &mut Record, path: &str) -> bool {
    record.paths.retain(|own| own.adapter.path != path);
    let fails = record.paths.iter().any(|own| own.failures > 0 && own.known_issue.is_none());
    if !fails && record.verdict == Verdict::Fail {
        (record.verdict, record.message) = (Verdict::Pass, None);
    }
    !record.paths.is_empty()
}
