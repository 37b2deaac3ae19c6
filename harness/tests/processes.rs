//! Every process that Karat starts has a deadline, or a reason why it needs none.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use syn::visit::{self, Visit};

/// The limit on the time of a process.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Bound {
    /// `lines::output`, `child::run` or a loop in the same file kills the process at its deadline.
    Deadline,
    /// The process replies to messages, and each reply has a deadline.
    Answers,
    /// The reason why the process needs no deadline.
    Needless(&'static str),
}

use Bound::{Answers, Deadline, Needless};

const OURS: Bound =
    Needless("it is this program again, whose dispatches and processes have deadlines");
const TESTS: Bound = Needless("tests take as long as they take; what they dispatch has deadlines");
const CARGO: Bound = Needless("cargo downloads, builds and waits for other builds");

/// Each file that starts processes, with the number of calls of `Command::new` in the file.
const KNOWN: &[(&str, usize, Bound)] = &[
    ("cli/src/cargo.rs", 1, OURS),
    ("cli/src/cli/browser.rs", 1, OURS),
    ("cli/src/cli/git.rs", 1, Deadline),
    ("cli/src/cli/init.rs", 1, OURS),
    ("cli/src/cli/loader.rs", 1, OURS),
    ("cli/src/cli/lsp/run.rs", 1, OURS),
    ("cli/src/cli/manual.rs", 3, CARGO), // and the browser, which returns when it has the page
    ("cli/src/cli/matrix.rs", 1, OURS),
    ("cli/src/cli/coverage.rs", 1, OURS),
    ("cli/src/cli/mutate.rs", 1, OURS),
    ("cli/src/cli/record.rs", 1, TESTS),
    ("cli/src/cli/render.rs", 1, CARGO),
    ("cli/src/cli/replay.rs", 2, TESTS),
    ("cli/src/cli/review.rs", 1, OURS),
    ("cli/src/cli/suite/cargo/libtest.rs", 1, TESTS),
    ("cli/src/cli/suite/cargo/programs.rs", 2, CARGO), // and `--list`, with a deadline
    ("cli/src/cli/test.rs", 2, TESTS),
    ("cli/src/cli/trace.rs", 1, OURS),
    ("cli/src/cli/watch/keys.rs", 1, OURS),
    ("cli/src/cli/watch/worker.rs", 1, OURS),
    ("cli/src/quiet.rs", 1, OURS),
    ("core/src/lines.rs", 1, Needless("`kill` ends at once")),
    ("review/src/git.rs", 1, Deadline),
    ("src/golden/acceptance.rs", 1, Deadline),
    ("src/package/cargo/metadata.rs", 2, CARGO), // and `rustc -vV`, with a deadline
    ("src/package/manifest.rs", 1, Deadline),
    ("src/path/web.rs", 2, Answers),
    ("src/tint/browser.rs", 1, Answers),
    ("src/tint/program.rs", 2, Deadline),
    ("src/tint/resident.rs", 1, Answers),
    ("translate/src/batch.rs", 1, Deadline),
    ("translate/src/compile.rs", 2, Deadline),
    ("translate/src/tool.rs", 2, Deadline),
];

/// A counter for the uses of `Command::new` outside tests.
#[derive(Default)]
struct Started(usize);

impl<'ast> Visit<'ast> for Started {
    fn visit_item_mod(&mut self, module: &'ast syn::ItemMod) {
        let is_test = module.attrs.iter().any(|attribute| {
            let tokens = attribute.meta.require_list().map(|list| list.tokens.to_string());
            let words = tokens.unwrap_or_default();
            attribute.path().is_ident("cfg")
                && words.split(|c: char| !c.is_alphanumeric()).any(|word| word == "test")
        });
        if !is_test {
            visit::visit_item_mod(self, module);
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let parts: Vec<String> = path.segments.iter().map(|one| one.ident.to_string()).collect();
        self.0 += usize::from(parts.ends_with(&["Command".to_owned(), "new".to_owned()]));
        visit::visit_path(self, path);
    }
}

fn started(text: &str) -> usize {
    let mut started = Started::default();
    started.visit_file(&syn::parse_file(text).expect("it compiles"));
    started.0
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("readable") {
        let path = entry.expect("readable").path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        match path.is_dir() {
            true if name == "tests" || name == "target" || name == "node_modules" => {}
            true => sources(&path, found),
            false if name.ends_with(".rs") && name != "tests.rs" => found.push(path),
            false => {}
        }
    }
}

#[test]
fn each_process_has_a_deadline_or_a_reason() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    sources(root, &mut files);
    assert!(files.len() > 500, "the sources of all crates: {}", files.len());
    let mut found = BTreeMap::new();
    for file in files {
        let count = started(&std::fs::read_to_string(&file).expect("UTF-8"));
        let name = file.strip_prefix(root).expect("it is below").to_string_lossy();
        if count > 0 {
            found.insert(name.replace('\\', "/"), count);
        }
    }
    let known: BTreeMap<String, usize> =
        KNOWN.iter().map(|(file, count, _)| ((*file).to_owned(), *count)).collect();
    assert_eq!(found, known, "a new process has a deadline (`lines::output`), and stands here");
    for (file, _, bound) in KNOWN {
        let text = std::fs::read_to_string(root.join(file)).expect("it is there");
        let ends = ["::output(&mut", "lines::output(", "child::run(", "self.command(", "printed("];
        let is = match bound {
            Deadline => ends.iter().any(|call| text.contains(call)),
            Answers => text.contains("Lines::start("),
            Needless(reason) => !reason.is_empty(),
        };
        assert!(is, "{file}: {bound:?}");
    }
}

#[test]
fn processes_are_found_wherever_they_are_started() {
    assert_eq!(started("fn f() { std::process::Command::new(\"a\"); g(Command::new(x)); }"), 2);
    assert_eq!(started("#[cfg(all(test, unix))] mod tests { fn f() { Command::new(\"a\"); } }"), 0);
    assert_eq!(started("fn f() { clap::Command::new2(); MetadataCommand::new(); }"), 0);
    assert_eq!(started("mod inner { fn f() { let make = Command::new; make(\"a\"); } }"), 1);
}
