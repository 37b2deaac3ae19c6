//! Asks one process with Tint about many texts. The process runs as long as Karat.

use std::process::Command;
use std::time::Duration;

use serde::Deserialize;

use super::answer::{self, Answer};
use super::browser::{PAGE, Page};
use super::find::Kind;
use super::{JUDGE, LONGEST, NoVerdict, Question};
use crate::lines::{Answers, Broken, Lines};
use crate::settings;

/// The time limit for starting the process. On a busy machine, Chromium takes some seconds to
/// start. Once, with no files in the disk cache, the start took 18 s.
const START: Duration = Duration::from_secs(45);
/// The time limit for one text, unless KARAT_TIMEOUT is lower. A text usually takes a millisecond.
const PATIENCE: Duration = Duration::from_secs(10);
/// The largest number of times that one call of [`ask`] starts the process. Some texts make the process end.
const MOST_STARTS: usize = 3;

const NODE: &str = include_str!("node.mjs");

pub(super) struct Resident {
    asked: Asked,
    version: String,
    id: u64,
}

enum Asked {
    Node(Lines),
    Browser(Page),
}

impl Asked {
    fn start(kind: &Kind) -> Result<Self, NoVerdict> {
        Ok(match kind {
            Kind::Node { node, package } => {
                let script = format!("{JUDGE}{NODE}");
                let mut command = Command::new(node);
                command.args(["--no-warnings", "--input-type=module", "--eval", &script, "--"]);
                Self::Node(Lines::start(command.arg(package), Answers::Stderr, b'\n', LONGEST)?)
            }
            Kind::Browser(program) => {
                let script = format!("{JUDGE}{PAGE}");
                Self::Browser(Page::open(program, START, (&script, LONGEST))?)
            }
            Kind::Program(_) => {
                return Err(Broken::Start(
                    "the program `tint` can't keep running: it checks one text and ends".to_owned(),
                )
                .into());
            }
        })
    }

    fn send(&mut self, question: &str) -> Result<(), NoVerdict> {
        match self {
            Self::Node(lines) => Ok(lines.send(question)?),
            Self::Browser(page) => page.send(question),
        }
    }

    fn receive(&mut self, patience: Duration) -> Result<String, NoVerdict> {
        match self {
            Self::Node(lines) => Ok(lines.receive(patience)?),
            Self::Browser(page) => page.receive(patience),
        }
    }
}

/// The first line that the process writes: the version of the program with Tint, or an error.
#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Greeting {
    Version(String),
    Error(String),
}

impl Resident {
    fn start(kind: &Kind) -> Result<Self, NoVerdict> {
        let mut asked = Asked::start(kind)?;
        let first = asked.receive(START.min(settings::deadline()))?;
        match serde_json::from_str(&first) {
            Ok(Greeting::Version(version)) => Ok(Self { asked, version, id: 1 }),
            Ok(Greeting::Error(error)) => Err(Broken::Start(error).into()),
            Err(_) => Err(NoVerdict::Garbage(crate::diagnostic::one_line(&first))),
        }
    }

    /// Sends all questions, and reads the answers one by one. If a question gets no answer, the list ends with the
    /// error of this question.
    fn ask(&mut self, questions: &[Question]) -> Vec<Result<Answer, NoVerdict>> {
        #[derive(serde::Serialize)]
        struct Numbered<'q> {
            id: u64,
            #[serde(flatten)]
            question: &'q Question,
        }
        let first = self.id;
        self.id += questions.len() as u64;
        let mut answers = Vec::with_capacity(questions.len());
        // Asks about an empty text last. If Tint answers the last real question twice, the second answer arrives before
        // the answer about the empty text.
        let last = Question::default();
        self.id += 1;
        for (id, question) in (first..).zip(questions.iter().chain([&last])) {
            let line = serde_json::to_string(&Numbered { id, question });
            if let Err(error) = self.asked.send(&line.expect("it is plain data")) {
                // The process may have answered some questions before it ended. The loop below reads these answers.
                if id == first {
                    return vec![Err(error)];
                }
                break;
            }
        }
        for (id, question) in (first..).zip(questions.iter().chain([&last])) {
            let answer = self.asked.receive(PATIENCE.min(settings::deadline()));
            let answer = answer.and_then(|line| answer::read(&line, id, &question.text));
            let broke = answer.is_err();
            match (answer, answers.last_mut()) {
                // The previous question got two answers.
                (Err(NoVerdict::Twice), Some(before)) => *before = Err(NoVerdict::Twice),
                (answer, _) => answers.push(answer),
            }
            if broke {
                break;
            }
        }
        answers.truncate(questions.len());
        answers
    }
}

/// Tint's verdicts on all texts, in the order of the questions. If a text ends the process, Karat starts the process
/// again.
pub(super) fn ask(
    kind: &Kind,
    resident: &mut Option<Resident>,
    questions: &[Question],
) -> Vec<Result<Answer, NoVerdict>> {
    let mut answers = Vec::with_capacity(questions.len());
    let mut starts = 0;
    while answers.len() < questions.len() {
        let running = match resident.take() {
            Some(running) => Ok(running),
            None if starts < MOST_STARTS => {
                starts += 1;
                Resident::start(kind)
            }
            None => {
                Err(Broken::Start(format!("Tint ended after each of {MOST_STARTS} starts")).into())
            }
        };
        match running {
            Ok(mut running) => {
                answers.extend(running.ask(&questions[answers.len()..]));
                let broke = matches!(answers.last(), Some(Err(_)));
                *resident = (!broke).then_some(running);
            }
            Err(error) => answers.resize(questions.len(), Err(error)),
        }
    }
    answers
}

pub(super) fn version(kind: &Kind, resident: &mut Option<Resident>) -> Result<String, NoVerdict> {
    let running = match resident {
        Some(running) => running,
        none => none.insert(Resident::start(kind)?),
    };
    Ok(running.version.clone())
}
