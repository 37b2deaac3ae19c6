//! The matrix as JUnit XML: one suite for each package, one case for each row and column.

use anyhow::Context;
use karat_inspect::matrix::{Cell, Finding, Matrix, Row, Status};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

/// Returns the XML text. A cell fails if it is wrong or misses its required status. A cell passes if it reaches its
/// required status, agrees with another column, or fails as declared. All other cells are skipped, with the reason.
pub(super) fn text(matrices: &[Matrix], required: &[(String, Status)]) -> anyhow::Result<String> {
    let mut report = Report::new("karat matrix");
    for matrix in matrices {
        let mut suite = TestSuite::new(matrix.package.as_str());
        let findings = matrix.findings();
        for row in matrix.rows.iter().filter(|row| row.is_judged()) {
            if let Some(error) = &row.error {
                let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
                status.set_message(error.lines().next().unwrap_or_default()).set_description(error);
                suite.add_test_case(TestCase::new(row.name.as_str(), status));
            }
            for (index, (head, cell)) in matrix.columns.iter().zip(&row.cells).enumerate() {
                let wanted = required.iter().find(|(name, _)| *name == head.name);
                let found = findings.iter().find(|f| f.row == row.name && f.column == head.name);
                let status = status(row, index, wanted.map(|(_, status)| *status), found);
                let mut case = TestCase::new(row.name.as_str(), status);
                case.set_classname(format!("{}.{}", matrix.package, head.name));
                case.set_system_out(evidence(cell));
                suite.add_test_case(case);
            }
        }
        report.add_test_suite(suite);
    }
    report.to_string().context("the report isn't XML")
}

fn status(
    row: &Row,
    column: usize,
    wanted: Option<Status>,
    finding: Option<&Finding>,
) -> TestCaseStatus {
    let said = |mut status: TestCaseStatus, text: &str| {
        status.set_message(text.lines().next().unwrap_or_default()).set_description(text);
        status
    };
    let failure = || TestCaseStatus::non_success(NonSuccessKind::Failure);
    if let Some(finding) = finding {
        return said(failure(), &finding.why);
    }
    let cell = &row.cells[column];
    match wanted {
        _ if cell.fails_as_declared().is_some() => TestCaseStatus::success(),
        Some(wanted) if cell.status >= Some(wanted) => TestCaseStatus::success(),
        Some(wanted) => {
            said(failure(), &format!("the row's status isn't `{wanted}`: {}", row.why(column)))
        }
        None if cell.status == Some(Status::Agrees) => TestCaseStatus::success(),
        None => said(TestCaseStatus::skipped(), &format!("{}: {}", cell.word(), row.why(column))),
    }
}

fn evidence(cell: &Cell) -> String {
    let mut lines = vec![format!("{}; {}", cell.word(), cell.options)];
    lines.extend(cell.validators.iter().map(|said| {
        let verdict = said.verdict.lines().next().unwrap_or_default();
        format!("{}: {verdict} ({})", said.command, said.version)
    }));
    if cell.compared > 0 {
        lines.push(format!("{} results compared, {} differ", cell.compared, cell.differing));
    }
    if cell.open > 0 {
        lines.push(format!("{} results differ where WGSL allows several results", cell.open));
    }
    lines.extend(cell.known.as_ref().map(|known| format!("known issue: {}", known.reason)));
    lines.join("\n")
}
