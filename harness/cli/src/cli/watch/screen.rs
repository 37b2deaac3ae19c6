//! The output of `karat watch`: a full screen on a terminal, otherwise lines.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

use crossterm::terminal::{self, Clear, ClearType};
use crossterm::{cursor, execute, queue, style};
use karat::unstable::output::visible;

use super::super::table::{BAD, DIM, GOOD, HEAD, KNOWN};
use super::{Lane, Resident, Verdicts};

pub(super) struct View<'v> {
    pub(super) folder: &'v Path,
    pub(super) filter: &'v str,
    /// The prompt with the text that the user is typing.
    pub(super) prompt: Option<String>,
    /// The message that the last pressed key caused.
    pub(super) notice: Option<&'v str>,
    pub(super) changed: &'v [String],
    pub(super) lanes: &'v [Lane],
}

/// The number of bytes at the end of a file in which Karat searches for the last printed line.
const TAIL: u64 = 64 << 10;

pub(super) struct Screen {
    full: bool,
    /// The last printed line that isn't a part of a message.
    last: RefCell<String>,
    failure: Cell<usize>,
    /// The index of the first visible line of the shown failure.
    top: Cell<usize>,
    /// The title of the failure that was drawn last.
    title: RefCell<String>,
}

struct Failure {
    title: String,
    message: String,
}

impl Screen {
    pub(super) fn lines() -> Self {
        Self {
            full: false,
            last: RefCell::default(),
            failure: Cell::new(0),
            top: Cell::new(0),
            title: RefCell::default(),
        }
    }

    /// Switches the terminal to a full screen, until the returned `Screen` is dropped.
    pub(super) fn full() -> std::io::Result<Self> {
        terminal::enable_raw_mode()?;
        execute!(std::io::stdout(), terminal::EnterAlternateScreen, cursor::Hide)?;
        let mut screen = Self::lines();
        screen.full = true;
        Ok(screen)
    }

    /// Shows the next failure. After the last failure, shows the first failure again.
    pub(super) fn turn(&self) {
        self.failure.set(self.failure.get() + 1);
        self.top.set(0);
    }

    pub(super) fn scroll(&self, lines: isize) {
        self.top.set(self.top.get().saturating_add_signed(lines));
    }

    /// Shows the first failure from its first line.
    pub(super) fn rewind(&self) {
        self.failure.set(0);
        self.top.set(0);
    }

    pub(super) fn say_changed(
        &self,
        changed: &[String],
        out: &mut dyn Write,
    ) -> std::io::Result<()> {
        if self.full {
            return Ok(());
        }
        let line = format!("changed: {}", changed.join(", "));
        writeln!(out, "{DIM}{line}{DIM:#}")?;
        self.last.replace(line);
        out.flush()
    }

    pub(super) fn say_failed(
        &self,
        path: &str,
        name: &str,
        message: &str,
        out: &mut dyn Write,
    ) -> std::io::Result<()> {
        if self.full {
            return Ok(());
        }
        writeln!(out, "{BAD}FAILED{BAD:#} {name} on {path}\n{}", message.trim_end())?;
        self.last.replace(format!("FAILED {name} on {path}"));
        out.flush()
    }

    pub(super) fn say_done(&self, lane: &Lane, out: &mut dyn Write) -> std::io::Result<()> {
        if self.full {
            return Ok(());
        }
        self.last.replace(words(lane).1);
        writeln!(out, "{}", summary(lane))?;
        for why in lane.verdicts.broken.iter().chain(&lane.verdicts.invalid) {
            writeln!(out, "{}", why.trim_end())?;
        }
        let remarks = lane.verdicts.remarks.iter().flat_map(|remarks| remarks.lines().skip(1));
        remarks.into_iter().try_for_each(|line| writeln!(out, "{line}"))?;
        out.flush()
    }

    /// Checks if a file contains the last printed line. An example is the file that `tee` writes.
    pub(super) fn is_printed_in(&self, file: &Path) -> bool {
        let last = self.last.borrow();
        let Some(length) = file.metadata().ok().filter(std::fs::Metadata::is_file) else {
            return false;
        };
        let read = || -> std::io::Result<Vec<u8>> {
            let mut end = File::open(file)?;
            end.seek(SeekFrom::Start(length.len().saturating_sub(TAIL)))?;
            let mut bytes = Vec::new();
            end.take(TAIL).read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        let has = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).contains(&**last);
        !last.is_empty() && read().is_ok_and(has)
    }

    pub(super) fn draw(&self, view: &View<'_>, out: &mut dyn Write) -> std::io::Result<()> {
        if !self.full {
            return Ok(());
        }
        let (columns, rows) = terminal::size().unwrap_or((80, 24));
        let (columns, rows) = (usize::from(columns).max(10), usize::from(rows).max(4));
        let mut lines: Vec<String> = Vec::new();
        let filter = if view.filter.is_empty() {
            String::new()
        } else {
            format!("  only `{}`", view.filter)
        };
        lines.push(styled(
            HEAD,
            &cut(
                &format!("karat watch {}{filter}", karat::unstable::diagnostic::shown(view.folder)),
                columns,
            ),
        ));
        if !view.changed.is_empty() {
            lines
                .push(styled(DIM, &cut(&format!("changed: {}", view.changed.join(", ")), columns)));
        }
        for lane in view.lanes {
            lines.push(summary_in(lane, columns));
        }
        if let Some(notice) = view.notice {
            lines.extend(notice.lines().flat_map(|line| wrapped(&visible(line), columns)));
        }
        lines.push(String::new());
        let failures = failures(view.lanes);
        let room = rows.saturating_sub(lines.len() + 1);
        let mut hidden = false;
        if !failures.is_empty() {
            self.failure.set(self.failure.get() % failures.len());
            let Failure { title, message } = &failures[self.failure.get()];
            // A different failure is now at this index. It is shown from its first line.
            if self.title.replace(title.clone()) != *title {
                self.top.set(0);
            }
            let title = match failures.len() {
                1 => title.clone(),
                count => format!("{} of {count}: {title}", self.failure.get() + 1),
            };
            lines.push(styled(BAD, &cut(&title, columns)));
            let body = message.lines().flat_map(|line| wrapped(&visible(line), columns));
            let body: Vec<String> = body.collect();
            let seen = room.saturating_sub(1).max(1);
            hidden = body.len() > seen;
            self.top.set(self.top.get().min(body.len().saturating_sub(seen)));
            lines.extend(body.into_iter().skip(self.top.get()));
        }
        let keys = match &view.prompt {
            Some(prompt) => prompt.clone(),
            None => keys(failures.len() > 1, hidden, columns),
        };
        lines.truncate(rows.saturating_sub(1));
        // If colours are off, the output strips all escape sequences, but the screen needs its own. Rows without text
        // are cleared.
        let mut commands = std::io::stdout();
        queue!(commands, cursor::MoveTo(0, 0))?;
        for row in 0..rows.saturating_sub(1) {
            write!(out, "{}", lines.get(row).map_or("", String::as_str))?;
            out.flush()?;
            queue!(commands, Clear(ClearType::UntilNewLine), style::Print("\r\n"))?;
        }
        write!(out, "{}", cut(&keys, columns))?;
        out.flush()?;
        queue!(commands, Clear(ClearType::FromCursorDown))?;
        commands.flush()
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        if self.full {
            drop(execute!(std::io::stdout(), cursor::Show, terminal::LeaveAlternateScreen));
            drop(terminal::disable_raw_mode());
        }
    }
}

/// Returns the failures to show. Ended processes, unreadable tests and invalid modules come first. Each failing test
/// follows once, with the message of the first path on which it fails.
fn failures(lanes: &[Lane]) -> Vec<Failure> {
    let broken = lanes.iter().filter_map(|lane| {
        let Verdicts { broken, invalid, .. } = &lane.verdicts;
        let message = broken.as_ref().or(invalid.as_ref())?.clone();
        Some(Failure { title: lane.name.clone(), message })
    });
    let mut tests: BTreeMap<&str, (Vec<&str>, &str)> = BTreeMap::new();
    for lane in lanes {
        for (name, wrong) in &lane.resident.failing {
            let known = tests.entry(name).or_insert((Vec::new(), &wrong.message));
            known.0.push(&lane.name);
        }
    }
    let tests = tests.into_iter().map(|(name, (paths, message))| Failure {
        title: format!("{name} on {}", paths.join(", ")),
        message: message.to_owned(),
    });
    broken.chain(tests).collect()
}

/// Returns the line that describes the keys. On a narrow terminal, the descriptions are shorter.
fn keys(several: bool, hidden: bool, columns: usize) -> String {
    // These keys come first, because the end of a long line is cut.
    let now = [(several, "n next"), (hidden, "\u{2191}\u{2193} scroll")];
    let now: Vec<&str> = now.into_iter().filter_map(|(does, key)| does.then_some(key)).collect();
    let join = |always: [&'static str; 5], gap| [&*now, &always].concat().join(gap);
    let long = join(["r run all", "f filter", "a accept", "o report", "q quit"], "   ");
    match long.chars().count() <= columns {
        true => long,
        false => join(["r all", "f filter", "a accept", "o open", "q quit"], "  "),
    }
}

fn styled(style: karat::unstable::output::Style, text: &str) -> String {
    format!("{style}{text}{style:#}")
}

/// Cuts a text to a number of columns.
fn cut(text: &str, columns: usize) -> String {
    match text.chars().count() > columns {
        true => text.chars().take(columns.saturating_sub(1)).chain(['>']).collect(),
        false => text.to_owned(),
    }
}

/// Wraps a text to a number of columns, and repeats the indentation of its first line. Cutting would lose the values at
/// the end of a line.
fn wrapped(text: &str, columns: usize) -> Vec<String> {
    let indent: String = text.chars().take_while(|c| *c == ' ').take(columns / 2).collect();
    let width = (columns - indent.len()).max(1);
    let mut rest: Vec<char> = text.chars().skip(indent.len()).collect();
    let mut lines = Vec::new();
    while rest.len() > width {
        // The line breaks between words, unless that leaves more than half of the line empty.
        let blank = rest[..=width].iter().rposition(|c| *c == ' ').filter(|at| *at > width / 2);
        let after = rest.split_off(blank.unwrap_or(width));
        lines.push(indent.chars().chain(rest).collect());
        rest = after.into_iter().skip(usize::from(blank.is_some())).collect();
    }
    lines.push(indent.chars().chain(rest).collect());
    lines
}

fn words(lane: &Lane) -> (karat::unstable::output::Style, String) {
    let Verdicts { ran, took, idle, broken, invalid, remarks } = &lane.verdicts;
    let Resident { failing, tests, busy, .. } = &lane.resident;
    let count = &tests.len();
    let mut took = format!("{:.1} ms", took.as_secs_f64() * 1e3);
    if let Some(remark) = remarks.as_ref().and_then(|remarks| remarks.lines().next()) {
        took = format!("{took}; {remark}");
    }
    let (took, good) = match idle {
        0 => (took, GOOD),
        1 => (format!("{took}; 1 frame isn't judged: frames need a driver"), KNOWN),
        more => (format!("{took}; {more} frames aren't judged: frames need a driver"), KNOWN),
    };
    let path = &lane.name;
    let pass = if *count == 1 { "1 test passes".to_owned() } else { format!("{count} tests pass") };
    match (busy, broken, failing.len()) {
        (true, ..) => (DIM, format!("{path}: running, {ran} done")),
        (_, Some(_), _) => (BAD, format!("{path}: no verdict  {took}")),
        (.., 0) if invalid.is_some() => {
            (BAD, format!("{path}: WGSL error; {pass}; {ran} ran in {took}"))
        }
        (.., 0) if *count == 0 && *idle == 0 => match lane.alone {
            true => (BAD, format!("{path}: there are no tests: `karat init` writes a first test")),
            false => (DIM, format!("{path}: no tests found  {took}")),
        },
        (.., 0) if *ran == 0 => (good, format!("{path}: {pass}; no code changed  {took}")),
        (.., 0) => (good, format!("{path}: {pass}; {ran} ran in {took}")),
        (.., failed) if invalid.is_some() => (
            BAD,
            format!("{path}: WGSL error; {failed} of {count} tests fail; {ran} ran in {took}"),
        ),
        (.., failed) => {
            (BAD, format!("{path}: {failed} of {count} tests fail; {ran} ran in {took}"))
        }
    }
}

fn summary(lane: &Lane) -> String {
    let (style, text) = words(lane);
    styled(style, &text)
}

fn summary_in(lane: &Lane, columns: usize) -> String {
    let (style, text) = words(lane);
    styled(style, &cut(&text, columns))
}

#[cfg(test)]
mod tests {
    use super::wrapped;

    #[test]
    fn lines_are_wrapped_between_words_and_keep_their_indent() {
        assert_eq!(wrapped("", 10), [""]);
        assert_eq!(wrapped("0123456789", 10), ["0123456789"]);
        assert_eq!(wrapped("  saw 0.75, not 1.5", 12), ["  saw 0.75,", "  not 1.5"]);
        assert_eq!(wrapped("a 0123456789abc", 10), ["a 01234567", "89abc"]);
    }
}
