//! A file that stores the inputs on which a test has failed. The test's next runs try these inputs first.
//!
//! The file is `.karat/failures/<target>/<test>.txt`, beside the package's `Cargo.toml`. It has one line for each
//! input. An input stays in the file even after it passes, until you delete the file. If the function or the domain no
//! longer accepts an input, Karat ignores the input and prints a note. With `KARAT_FAILURES=off`, Karat neither reads
//! nor writes the file. In CI, and if `KARAT_OVERLAY` is set, Karat reads the file but doesn't write it.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::identity::{write_steps, write_words};
use super::{Identity, host};
use crate::output::name_within;
use crate::settings::{read_steps, read_words};

const HEAD: &str = "\
# Inputs on which checks of this test have failed. The test's next runs try them first, even
# after they pass. Delete the file if you don't need the inputs any more.
# Format of each line: function, check, path, arguments as hexadecimal u32s (- for none), seed:case:steps # arguments
";

/// The stored inputs on which one test failed.
#[derive(Debug)]
pub(crate) struct Memory {
    file: PathBuf,
    entries: Vec<Entry>,
    writable: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    pub(crate) function: String,
    pub(crate) check: String,
    /// The first path on which the input failed. Karat tries the input on every path.
    pub(crate) path: String,
    /// The words of the arguments. Empty for a check of an integral: Karat makes the check's case again from `descent`.
    pub(crate) words: Vec<u32>,
    /// The seed, the case and the steps from which Karat made the input. Some domains, such as mapped
    /// domains, can't tell if they contain a value. For such a domain, Karat makes the input again from its origin. If
    /// the new input differs from the stored input, Karat ignores the stored input.
    pub(crate) descent: Descent,
    /// The arguments, as text for people.
    pub(crate) comment: String,
}

/// The origin of a simplified value: the seed and the index of the original case, and the index of the simpler value
/// that Karat chose in each step of the simplification.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Descent {
    pub(crate) seed: u64,
    pub(crate) case: u64,
    pub(crate) steps: Vec<usize>,
}

impl Memory {
    /// Reads the inputs of the running test. `None` if a replay selects one case, if the memory is turned off,
    /// or if Karat doesn't know the program that runs the test.
    pub(crate) fn open(identity: &Identity) -> Option<Self> {
        if !identity.remembers() {
            return None;
        }
        let folder = match host::current() {
            Some(host) => host.failures(),
            None => {
                let package = std::env::var_os("CARGO_MANIFEST_DIR")?;
                let exe = std::env::current_exe().ok()?;
                let stem = exe.file_stem()?.to_string_lossy().into_owned();
                let target = stem.rsplit_once('-').map_or(&*stem, |(name, _)| name);
                host::failures(Path::new(&package), target)
            }
        };
        let ci = crate::golden::in_ci();
        // Under an overlay, the failing module belongs to the overlay, not to the package.
        let writable = !ci && crate::settings::overlay().is_none() && crate::record::is_kept();
        Some(Self::read(folder.join(format!("{}.txt", file_name(&identity.test))), writable))
    }

    fn read(file: PathBuf, writable: bool) -> Self {
        let mut entries = Vec::new();
        match std::fs::read_to_string(&file) {
            Ok(text) => {
                for (number, line) in (1..).zip(text.lines()) {
                    if line.trim().is_empty() || line.starts_with('#') {
                        continue;
                    }
                    match Entry::parse(line) {
                        Some(entry) => entries.push(entry),
                        None => note(
                            &file,
                            &format!(
                                "line {number} isn't a failing input, so Karat ignores the line"
                            ),
                        ),
                    }
                }
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => note(&file, &format!("can't be read: {error}")),
        }
        Self { file, entries, writable }
    }

    /// The stored inputs of one check, without duplicates.
    pub(crate) fn of(&self, function: &str, check: &str) -> Vec<&Entry> {
        let mut found: Vec<&Entry> = Vec::new();
        for entry in &self.entries {
            let own = entry.function == function && entry.check == check;
            if own && found.iter().all(|other| !other.is_same(entry)) {
                found.push(entry);
            }
        }
        found
    }

    /// Prints a note that the check ignores an input.
    pub(crate) fn ignore(&self, entry: &Entry, reason: &str) {
        let Entry { function, check, comment, .. } = entry;
        note(&self.file, &format!("`{function}` {check} ({comment}) is ignored: {reason}"));
    }

    /// Adds an input to the file, unless the file contains it already.
    pub(crate) fn keep(&self, entry: &Entry) {
        let known = self.of(&entry.function, &entry.check);
        if !self.writable || known.iter().any(|known| known.is_same(entry)) {
            return;
        }
        if let Err(error) = self.append(entry) {
            note(&self.file, &format!("can't keep the failing input: {error}"));
        }
    }

    fn append(&self, entry: &Entry) -> std::io::Result<()> {
        if let Some(folder) = self.file.parent() {
            std::fs::create_dir_all(folder)?;
        }
        // Two paths may fail on the same input. Processes can share the file, because each appends whole lines.
        let text = match std::fs::read_to_string(&self.file) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            read => read?,
        };
        let same = |line: &str| {
            Entry::parse(line).is_some_and(|old| {
                (&old.function, &old.check) == (&entry.function, &entry.check) && old.is_same(entry)
            })
        };
        if text.lines().any(same) {
            return Ok(());
        }
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(&self.file)?;
        let head = if text.is_empty() { HEAD } else { "" };
        file.write_all(format!("{head}{}\n", entry.line()).as_bytes())
    }
}

impl Entry {
    /// Checks if both entries have the same input.
    fn is_same(&self, other: &Self) -> bool {
        match (&*self.words, &*other.words) {
            ([], []) => self.comment == other.comment,
            (own, others) => own == others,
        }
    }

    fn line(&self) -> String {
        let Self { function, check, path, descent, comment, .. } = self;
        let Descent { seed, case, steps } = descent;
        let words = if self.words.is_empty() { "-" } else { &write_words(&self.words) };
        let steps = write_steps(steps);
        format!("{function} {check} {path} {words} {seed:#x}:{case}:{steps} # {comment}")
    }

    fn parse(line: &str) -> Option<Self> {
        let (fields, comment) = line.split_once(" # ").unwrap_or((line, ""));
        let fields: Vec<&str> = fields.split_whitespace().collect();
        let [function, check, path, words, origin] = *fields else { return None };
        let mut origin = origin.splitn(3, ':');
        let seed = u64::from_str_radix(origin.next()?.strip_prefix("0x")?, 16).ok()?;
        let case = origin.next()?.parse().ok()?;
        let steps = read_steps(origin.next()?)?;
        Some(Self {
            function: function.to_owned(),
            check: check.to_owned(),
            path: path.to_owned(),
            words: if words == "-" { Vec::new() } else { read_words(words)? },
            descent: Descent { seed, case, steps },
            comment: comment.to_owned(),
        })
    }
}

/// The largest number of bytes in a file's name, without its extension. Systems allow 255.
const LONGEST: usize = 200;

fn file_name(test: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || c == '_' { c } else { '-' };
    let plain: String = test.replace("::", "__").chars().map(plain).collect();
    name_within(&plain, LONGEST).into_owned()
}

/// Prints a line to standard error. Test runners show such lines for tests that fail.
fn note(file: &Path, text: &str) {
    let line = format!("note: `{}`: {text}", file.display());
    eprintln!("{}", crate::output::visible(&line));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(words: &[u32]) -> Entry {
        Entry {
            function: "m::f".to_owned(),
            check: "agrees_with".to_owned(),
            path: "gl".to_owned(),
            words: words.to_vec(),
            descent: Descent { seed: 0x12, case: 7, steps: vec![3, 0] },
            comment: "x = 1, y = (0, # 2)".to_owned(),
        }
    }

    #[test]
    fn a_remembered_failure_round_trips_as_one_line() {
        let line = entry(&[0x3f80_0000, 0]).line();
        let expected = "m::f agrees_with gl 3f800000,00000000 0x12:7:3.0 # x = 1, y = (0, # 2)";
        assert_eq!(line, expected);
        assert_eq!(Entry::parse(&line), Some(entry(&[0x3f80_0000, 0])));
        let descent = Descent { seed: 1, case: 2, steps: vec![] };
        let none = Entry { descent, ..entry(&[]) };
        assert!(none.line().starts_with("m::f agrees_with gl - 0x1:2: # "), "{}", none.line());
        assert_eq!(Entry::parse(&none.line()), Some(none));
        for bad in
            ["", "m::f", "m::f agrees_with gl 3f8x 0x1:2:", "m::f a gl 0 1:2:", "a b c 0 0x1:2"]
        {
            assert_eq!(Entry::parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn inputs_are_kept_once_and_bad_lines_are_passed_over() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("a").join("t.txt");
        let memory = Memory::read(file.clone(), true);
        for words in [[1], [2], [1]] {
            memory.keep(&entry(&words));
        }
        let text = std::fs::read_to_string(&file).expect("written");
        std::fs::write(&file, format!("{text}nonsense\n")).expect("written");
        let memory = Memory::read(file.clone(), false);
        let words: Vec<_> = memory.of("m::f", "agrees_with").iter().map(|e| e.words[0]).collect();
        assert_eq!(words, [1, 2]);
        assert!(memory.of("m::f", "satisfies").is_empty());
        memory.keep(&entry(&[3]));
        assert!(!std::fs::read_to_string(&file).expect("there").contains("00000003"), "in CI");
    }

    #[test]
    fn a_place_that_cannot_be_written_is_no_panic() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("file");
        std::fs::write(&file, "").expect("written");
        Memory::read(file.join("t.txt"), true).keep(&entry(&[1]));
        Memory::read(folder.path().to_owned(), true).keep(&entry(&[1]));
    }

    #[test]
    fn each_test_has_its_own_file_name_for_failures() {
        assert_eq!(file_name("a::b::test_1"), "a__b__test_1");
        assert_eq!(file_name("main/.."), "main---");
        let [one, other] = ["a", "b"].map(|end| file_name(&("n".repeat(900) + end)));
        assert!(one.len() == 200 && one != other, "{one}");
    }
}
