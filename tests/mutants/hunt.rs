//! Runs mutants against the tests, and tells what became of them.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use rayon::prelude::*;

use crate::library::{self, Library, Seen};
use crate::program::{self, Candidate, JUDGES, Listed};

/// What became of a mutant.
pub(crate) enum Fate {
    /// naga doesn't accept it. It shows nothing of the tests.
    Invalid,
    Killed(String),
    /// A test fails, but no check of it came to a verdict.
    NoVerdict(String),
    Survived,
    /// It survives, and is listed with this reason.
    Excused(String),
    /// It is listed, but this test kills it.
    Unexcused(String),
}

/// Mutants with what became of them.
#[derive(Default)]
pub(crate) struct Hunt {
    pub(crate) fates: Vec<(Candidate, Fate)>,
    /// Tests that fail without a mutant.
    pub(crate) broken: Vec<String>,
}

/// The files of tests that judge some mutants, compiled.
pub(crate) fn judges(candidates: &[Candidate]) -> Library {
    let targets = candidates.iter().flat_map(|candidate| candidate.judges.iter().copied());
    Library::of(&targets.collect())
}

impl Hunt {
    /// Runs the tests of each module as it is: a test that fails then kills no mutant.
    pub(crate) fn control(&mut self, library: &Library, candidates: &[Candidate]) {
        let modules: BTreeSet<&str> = candidates.iter().map(|candidate| candidate.module).collect();
        let judges = JUDGES.into_iter().filter(|(module, _)| modules.contains(module));
        let runs: Vec<_> = judges
            .flat_map(|(module, targets)| targets.iter().map(move |t| (module, *t)))
            .collect();
        self.broken.par_extend(runs.par_iter().filter_map(|(module, target)| match library.hunt(
            target,
            &[],
            module,
            &library::text(module),
        ) {
            Seen::Survived => None,
            Seen::Killed(why) | Seen::Asserted(why) | Seen::NoVerdict(why) => {
                Some(format!("{module} as it is: {why} fails"))
            }
        }));
    }

    /// Tries mutants, `most` valid ones at most.
    pub(crate) fn run(
        &mut self,
        library: &Library,
        candidates: Vec<Candidate>,
        listed: &[Listed],
        most: usize,
    ) {
        let mut waiting = candidates.into_iter();
        let mut valid = 0;
        while valid < most {
            let batch: Vec<Candidate> = waiting.by_ref().take((most - valid).min(64)).collect();
            if batch.is_empty() {
                return;
            }
            let fates: Vec<(Candidate, Fate)> = batch
                .into_par_iter()
                .map(|candidate| {
                    let fate = fate(library, &candidate, listed);
                    if matches!(fate, Fate::Survived) {
                        eprintln!("{candidate} survives"); // a long run's first results
                    }
                    (candidate, fate)
                })
                .collect();
            valid += fates.iter().filter(|(_, fate)| !matches!(fate, Fate::Invalid)).count();
            self.fates.extend(fates);
        }
    }

    /// What has to be mended: in the tests, in the shaders, or in the list.
    pub(crate) fn problems(&self) -> Vec<String> {
        let problem = |(candidate, fate): &(Candidate, Fate)| match fate {
            Fate::Survived => Some(format!("{candidate} survives")),
            Fate::Unexcused(test) => {
                Some(format!("{candidate} is listed in survivors.toml, but {test} kills it"))
            }
            _ => None,
        };
        self.broken.iter().cloned().chain(self.fates.iter().filter_map(problem)).collect()
    }

    /// The numbers by module, then the mutants that weren't simply killed.
    pub(crate) fn report(&self) -> String {
        let mut text = String::from(
            "# Mutants made by a program\n\n\
             | module | made | invalid | killed | no verdict | survived | listed |\n\
             |---|---|---|---|---|---|---|\n",
        );
        let modules = JUDGES.iter().map(|(module, _)| Some(*module)).chain([None]);
        for module in modules {
            let of = |(candidate, _): &&(Candidate, Fate)| {
                module.is_none_or(|module| candidate.module == module)
            };
            let fates: Vec<&Fate> = self.fates.iter().filter(of).map(|(_, fate)| fate).collect();
            if fates.is_empty() {
                continue;
            }
            let count = |is: fn(&Fate) -> bool| fates.iter().filter(|fate| is(fate)).count();
            let _ = writeln!(
                text,
                "| {} | {} | {} | {} | {} | {} | {} |",
                module.unwrap_or("all"),
                fates.len(),
                count(|fate| matches!(fate, Fate::Invalid)),
                count(|fate| matches!(fate, Fate::Killed(_) | Fate::Unexcused(_))),
                count(|fate| matches!(fate, Fate::NoVerdict(_))),
                count(|fate| matches!(fate, Fate::Survived)),
                count(|fate| matches!(fate, Fate::Excused(_))),
            );
        }
        let mut section = |title: &str, told: &dyn Fn(&Fate) -> Option<String>| {
            let lines = self.fates.iter().filter_map(|(candidate, fate)| {
                let [_, after] = &candidate.lines;
                Some(format!("- {candidate}: `{after}`{}", told(fate)?))
            });
            let lines: Vec<String> = lines.collect();
            if !lines.is_empty() {
                let _ = write!(text, "\n## {title}\n\n{}\n", lines.join("\n"));
            }
        };
        section("Survived", &|fate| matches!(fate, Fate::Survived).then(String::new));
        section("Listed, but killed", &|fate| match fate {
            Fate::Unexcused(test) => Some(format!(" by {test}")),
            _ => None,
        });
        section("Without a verdict", &|fate| match fate {
            Fate::NoVerdict(why) => Some(format!(": {why}")),
            _ => None,
        });
        section("Listed", &|fate| match fate {
            Fate::Excused(reason) => Some(format!(": {reason}")),
            _ => None,
        });
        section("Killed", &|fate| match fate {
            Fate::Killed(test) => Some(format!(" by {test}")),
            _ => None,
        });
        text
    }
}

/// Runs the tests of a mutant's module until one of them kills it, those first that killed others of
/// the same function. Linking takes longer than most
/// tests do: naga is asked only about those that no check has proved to be valid by failing.
fn fate(library: &Library, candidate: &Candidate, listed: &[Listed]) -> Fate {
    let text = candidate.text();
    let reason = listed.iter().find(|listed| listed.is(candidate)).map(|listed| &listed.reason);
    let killed = |test| match reason {
        None => Fate::Killed(test),
        Some(_) => Fate::Unexcused(test),
    };
    let item = format!("{}::{}", candidate.module, candidate.mutant.item);
    for target in candidate.judges {
        let likely = library.killers(target, &item);
        let likely: Vec<&str> = likely.iter().map(String::as_str).collect();
        if !likely.is_empty()
            && let Seen::Killed(test) = library.hunt(target, &likely, candidate.module, &text)
        {
            return killed(test);
        }
    }
    let mut undecided = None;
    let mut asserted = None;
    for target in candidate.judges {
        let tests = program::frames(candidate.module, target);
        match library.hunt(target, tests, candidate.module, &text) {
            Seen::Killed(test) => {
                library.learn(target, &item, &test);
                return killed(test);
            }
            Seen::Asserted(test) => {
                asserted = Some(test);
                break;
            }
            Seen::NoVerdict(why) => undecided = Some(why),
            Seen::Survived => {}
        }
    }
    if candidate.invalid().is_some() {
        return Fate::Invalid;
    }
    match (asserted, undecided, reason) {
        (Some(test), ..) => killed(test),
        (None, Some(why), _) => Fate::NoVerdict(why),
        (None, None, Some(reason)) => Fate::Excused(reason.clone()),
        (None, None, None) => Fate::Survived,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use karat_mutate::{Mutant, Rule};

    /// A slip in `camera.wgsl`, wherever `original` stands first.
    fn slip(original: &str, replacement: &str) -> Candidate {
        let text = library::text("camera");
        let start = text.find(original).expect("it is there");
        let mutant = Mutant {
            rule: Rule::Number,
            item: "covering_corner".to_owned(),
            range: start..start + original.len(),
            original: original.to_owned(),
            replacement: replacement.to_owned(),
            line: 1,
            column: 1,
        };
        let lines = mutant.lines(&text);
        Candidate { module: "camera", judges: &["camera"], mutant, lines }
    }

    fn excuse(candidate: &Candidate) -> Listed {
        Listed {
            module: "camera".to_owned(),
            item: candidate.mutant.item.clone(),
            lines: candidate.lines.clone(),
            reason: "it is the same".to_owned(),
        }
    }

    #[test]
    fn only_a_failing_check_kills() {
        let library = Library::of(&BTreeSet::from(["camera"]));
        let (same, other) = (slip("return 4.0", "return 4.00"), slip("return 4.0", "return 3.0"));
        let invalid = slip("return 4.0", "return 4u");
        assert!(matches!(fate(&library, &invalid, &[]), Fate::Invalid));
        assert!(matches!(fate(&library, &same, &[]), Fate::Survived));
        assert!(matches!(fate(&library, &same, &[excuse(&same)]), Fate::Excused(_)));
        let excused = fate(&library, &other, &[excuse(&other)]);
        assert!(matches!(excused, Fate::Unexcused(test) if test == "camera::covering_corner"));
        let killed = fate(&library, &other, &[excuse(&same)]);
        assert!(matches!(killed, Fate::Killed(test) if test == "camera::covering_corner"));
        // The check can't be made without its function.
        let renamed = library::text("camera").replace("fn covering_corner", "fn covering");
        let seen = library.hunt("camera", &[], "camera", &renamed);
        assert!(matches!(seen, Seen::NoVerdict(why) if why.contains("camera::covering_corner: ")));
    }

    #[test]
    fn a_report_tells_each_fate_and_only_some_are_problems() {
        let fates = [
            Fate::Invalid,
            Fate::Killed("camera::a".to_owned()),
            Fate::NoVerdict("camera::b: why".to_owned()),
            Fate::Survived,
            Fate::Excused("a reason".to_owned()),
            Fate::Unexcused("camera::c".to_owned()),
        ];
        let broken = vec!["camera as it is: camera::d fails".to_owned()];
        let fates = fates.into_iter().map(|fate| (slip("4.0", "3.0"), fate)).collect();
        let hunt = Hunt { fates, broken };
        let problems = hunt.problems();
        assert_eq!(problems.len(), 3, "{problems:?}");
        let report = hunt.report();
        assert!(
            report.contains("| camera | 6 | 1 | 2 | 1 | 1 | 1 |\n| all | 6 | 1 | 2 | 1 | 1 | 1 |")
        );
        for told in
            ["by camera::a", ": camera::b: why", "## Survived", ": a reason", "by camera::c"]
        {
            assert!(report.contains(told), "{told} isn't in\n{report}");
        }
    }
}
