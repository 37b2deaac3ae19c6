//! One row: translated, validated, executed and compared on each column.

use karat_translate::{Shader, Target, Tool, TranslateError, Translation, Verdict};

use super::compute::run_entry_points;
use super::execute::{Comparison, Judge, Ready, not_run, shown};
use super::reduce::Pair;
use super::{Cell, Column, Request, Row, Said, Status, Stop, inputs};
use crate::package::FunctionItem;
use crate::path::Via;
use crate::probe::{ProbeError, Probed};
use crate::reflect::{Program, ReflectError};
use crate::value::Scalar;

/// What a row is about, and its row.
pub(super) fn make(request: &Request, item: &FunctionItem) -> Row {
    let row = |kind: &str, error, cells| Row {
        name: item.name.clone(),
        kind: kind.to_owned(),
        location: item.span.to_string(),
        error,
        cells,
    };
    if item.entry_point {
        return match of_entry_point(request, item) {
            Ok((kind, cells)) => row(&kind, None, cells),
            Err(error) => row("entry point", Some(error), Vec::new()),
        };
    }
    match Probed::new(&request.package, &item.name) {
        Ok(probed) => match Shader::parse(probed.kernel()) {
            Ok(shader) => row("function", None, of_function(request, &probed, &shader)),
            Err(error) => row("function", Some(error.to_string()), Vec::new()),
        },
        // It has no value to pass or to compare, or belongs to another stage: nothing calls it.
        Err(ProbeError::Reflect(ReflectError::Unprobeable(why))) => {
            row("not callable", Some(why.to_string()), Vec::new())
        }
        Err(error) => row("function", Some(error.to_string()), Vec::new()),
    }
}

/// The translations of one shader into each language that a column wants, made once.
struct Translations<'s> {
    shader: &'s Shader,
    entry_point: &'s str,
    made: Vec<((Target, Reader), Made)>,
}

/// Who has to read a translation, besides the validators.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reader {
    Driver,
    /// naga, which takes it in again.
    Naga,
}

/// A translation with what the validators say of it.
type Made = Result<(Translation, Vec<Said>), TranslateError>;

impl Translations<'_> {
    /// How far translation and validation get.
    fn cell(&mut self, column: Column) -> Cell {
        let target = column.target;
        let again = column.path.is_some_and(|path| matches!(path.via(), Via::Spirv | Via::Wgsl));
        let reader = if again { Reader::Naga } else { Reader::Driver };
        let wanted = (target, reader);
        let index = match self.made.iter().position(|(made, _)| *made == wanted) {
            Some(index) => index,
            None => {
                let translation = self.shader.translate(target, Some(self.entry_point));
                let made = translation.map(|t| {
                    let said = judged(&t, reader);
                    (t, said)
                });
                self.made.push((wanted, made));
                self.made.len() - 1
            }
        };
        let nothing = Cell {
            status: None,
            stopped: None,
            options: String::new(),
            validators: Vec::new(),
            compared: 0,
            differing: 0,
            worst_ulp: None,
        };
        match &self.made[index].1 {
            Err(error) => {
                let stopped = Some(Stop::Unsupported(error.to_string()));
                Cell { stopped, ..nothing }
            }
            Ok((translation, said)) => {
                let (own, of_route) = said.split_at(said.len() - usize::from(reads(reader, said)));
                let rejects = rejection(own);
                let (status, stopped) = match rejects {
                    Some(said) => {
                        let text = format!("`{}`: {}", said.command, said.verdict);
                        (Status::Translated, Some(Stop::Rejected(text)))
                    }
                    None if own.is_empty() => {
                        (Status::Translated, Some(Stop::NoValidator(no_validator(target))))
                    }
                    None => (
                        Status::Valid,
                        of_route.iter().find(|said| said.verdict != VALID).map(|said| {
                            Stop::Unsupported(format!(
                                "naga doesn't read it back: {}",
                                said.verdict
                            ))
                        }),
                    ),
                };
                let (options, validators) = (translation.options.clone(), said.clone());
                Cell { status: Some(status), stopped, options, validators, ..nothing }
            }
        }
    }
}

const VALID: &str = "valid";

/// Whether the last that is said is whether naga reads the translation back, which is no verdict on
/// it.
fn reads(reader: Reader, said: &[Said]) -> bool {
    reader == Reader::Naga && said.last().is_some_and(|said| said.command.ends_with(".spv"))
}

/// The validator that rejects a translation. `spirv-cross` writes source text of it, and doesn't know
/// all that is valid: where `spirv-val` accepts, it isn't asked.
fn rejection(said: &[Said]) -> Option<&Said> {
    let of = |said: &Said, tool: &str| said.command.starts_with(tool);
    let accepted = said.iter().any(|said| of(said, "spirv-val") && said.verdict == VALID);
    let counts = |said: &&Said| !(accepted && of(said, "spirv-cross"));
    said.iter().filter(counts).find(|said| said.verdict != VALID)
}

/// What each validator that is here says of a translation.
fn judged(translation: &Translation, reader: Reader) -> Vec<Said> {
    let say = |tool: &Tool| match tool.validate(translation) {
        Ok(said) => Said {
            command: said.command,
            version: said.version,
            verdict: match said.verdict {
                Verdict::Valid => VALID.to_owned(),
                Verdict::Invalid(message) => format!("invalid: {message}"),
                Verdict::Crashed(message) => format!("the validator crashes: {message}"),
                Verdict::TimedOut => "the validator doesn't end".to_owned(),
            },
        },
        Err(error) => Said {
            command: tool.name().to_owned(),
            version: tool.version().to_owned(),
            verdict: format!("it can't be run: {error}"),
        },
    };
    let naga = Some(Tool::naga())
        .filter(|naga| reader == Reader::Naga && !naga.targets().contains(&translation.target));
    Tool::of(translation.target).chain(naga).map(say).collect()
}

fn no_validator(target: Target) -> String {
    let missing = Tool::all().iter().filter_map(|tool| tool.as_ref().err());
    let names: Vec<_> = missing.filter(|m| m.targets.contains(&target)).map(|m| m.name).collect();
    format!("none of the validators of {target} is here: {}", names.join(", "))
}

fn of_entry_point(request: &Request, item: &FunctionItem) -> Result<(String, Vec<Cell>), String> {
    let (module, own) = item.name.rsplit_once("::").unwrap_or(("", &item.name));
    let program = Program::of_module(&request.package.for_validating(module), module);
    let program = program.map_err(|error| error.to_string())?;
    let shader = Shader::parse(program.text()).map_err(|error| error.to_string())?;
    let name = program.entry_point_name(own);
    let known = shader.entry_points().into_iter().find(|e| e.name == name);
    let known = known.ok_or_else(|| format!("naga has no entry point `{name}`"))?;
    let mut translations =
        Translations { shader: &shader, entry_point: &known.name, made: Vec::new() };
    let mut cells: Vec<Cell> =
        request.columns.iter().map(|column| translations.cell(*column)).collect();
    let stage = known.stage;
    let data = match program.compute_entry_point(&known.name) {
        Some((bindings, size)) => {
            let workgroups = inputs::INVOCATIONS.div_ceil(size.iter().product::<u32>().max(1));
            inputs::data(&program, &bindings).map(|data| (data, workgroups))
        }
        None => Err(format!("a {stage} entry point isn't run, only translated and validated")),
    };
    run_entry_points(request, &program, &known.name, data.as_ref(), &mut cells);
    Ok((stage.to_string(), cells))
}

/// What a column made of the inputs.
struct Ran<'p> {
    column: usize,
    ready: Ready<'p>,
    results: Vec<u32>,
}

fn of_function(request: &Request, probed: &Probed, shader: &Shader) -> Vec<Cell> {
    let entry_point = Probed::ENTRY_POINT;
    let mut translations = Translations { shader, entry_point, made: Vec::new() };
    let mut cells: Vec<Cell> =
        request.columns.iter().map(|column| translations.cell(*column)).collect();
    let rows = inputs::rows(probed, request.cases);
    let fixtures = inputs::fixtures(probed);
    let mut ran: Vec<Ran<'_>> = Vec::new();
    // Where one driver says that a loop doesn't end, others would hang.
    let mut endless: Option<String> = None;
    for (index, column) in request.columns.iter().enumerate() {
        let cell = &mut cells[index];
        if cell.stopped.is_some() {
            continue;
        }
        let results = match (&fixtures, column.path, &endless) {
            (_, None, _) => Err(Stop::Unavailable(format!("no path here runs {}", column.target))),
            (Err(why), ..) | (_, _, Some(why)) => Err(Stop::NotRun(why.clone())),
            (Ok(fixtures), Some(path), None) => {
                run(request, path, probed, fixtures, &rows, &mut endless)
            }
        };
        match results {
            Ok((ready, results)) => {
                cell.status = Some(Status::Executed);
                ran.push(Ran { column: index, ready, results });
            }
            Err(stop) => cell.stopped = Some(stop),
        }
    }
    compare_all(request, probed, &rows, &ran, &mut cells);
    cells
}

fn run<'p>(
    request: &Request,
    path: crate::path::Path,
    probed: &'p Probed,
    fixtures: &'p crate::fixture::Fixtures,
    rows: &[u32],
    endless: &mut Option<String>,
) -> Result<(Ready<'p>, Vec<u32>), Stop> {
    // A path that isn't here is one thing, a function that doesn't run there another.
    crate::path::adapter(path).map_err(|error| Stop::Unavailable(error.to_string()))?;
    let mut stop = |error: ProbeError| {
        if let ProbeError::Rounds { .. } = error {
            *endless = Some(format!("on `{path}` a loop of it doesn't end for these inputs"));
        }
        Stop::NotRun(not_run(error))
    };
    let ready = Ready::new(path, probed, fixtures, request.cases).map_err(&mut stop)?;
    let results = ready.results(rows, request.cases).map_err(stop)?;
    Ok((ready, results))
}

/// Compares each column with the first one that ran, and that one with the next.
fn compare_all(
    request: &Request,
    probed: &Probed,
    rows: &[u32],
    ran: &[Ran<'_>],
    cells: &mut [Cell],
) {
    let scalars = probed.function().result.lanes();
    let [first, others @ ..] = ran else { return };
    if others.is_empty() {
        let alone = "no other column ran it".to_owned();
        cells[first.column].stopped = Some(Stop::NothingToCompare(alone));
        return;
    }
    let judge = Judge::new(&scalars, &request.within, &first.results);
    let mut agreeing: Option<Comparison> = None;
    for other in others {
        let seen = judge.compare(&first.results, &other.results);
        let baseline = request.columns[first.column];
        let cell = &mut cells[other.column];
        (cell.compared, cell.differing, cell.worst_ulp) =
            (seen.compared, seen.differing.len(), seen.worst_ulp);
        if seen.compared == 0 {
            let none = "no case has a finite result".to_owned();
            cell.stopped = Some(Stop::NothingToCompare(none));
        } else if let Some(case) = seen.differing.first() {
            let text = difference(request, probed, rows, (first, other), *case, &judge);
            let (count, compared) = (seen.differing.len(), seen.compared);
            let text = format!("{count} of {compared} cases differ from `{baseline}`: {text}");
            cell.stopped = Some(Stop::Differs(text));
        } else {
            cell.status = Some(Status::Agrees);
            agreeing.get_or_insert(seen);
        }
    }
    // What one agrees with agrees with it.
    let cell = &mut cells[first.column];
    match agreeing {
        Some(seen) => {
            cell.status = Some(Status::Agrees);
            (cell.compared, cell.worst_ulp) = (seen.compared, seen.worst_ulp);
        }
        None => {
            let none = "no other column agrees with it".to_owned();
            cell.stopped = Some(Stop::NothingToCompare(none));
        }
    }
}

/// The simplest input on which two columns differ, with what each returns.
fn difference(
    request: &Request,
    probed: &Probed,
    rows: &[u32],
    (first, other): (&Ran<'_>, &Ran<'_>),
    case: usize,
    judge: &Judge<'_>,
) -> String {
    let function = probed.function();
    let arguments: Vec<Scalar> =
        function.parameters.iter().flat_map(|(_, shape)| shape.lanes()).collect();
    let results = function.result.lanes();
    let pair = Pair {
        expected: &first.ready,
        actual: &other.ready,
        arguments: &arguments,
        results: &results,
        judge,
    };
    let row = rows[case * arguments.len()..][..arguments.len()].to_vec();
    let of = |ran: &Ran<'_>| ran.results[case * results.len()..][..results.len()].to_vec();
    let (row, expected, actual) =
        pair.reduce(row.clone()).unwrap_or_else(|| (row, of(first), of(other)));
    let mut at = 0;
    let named = function.parameters.iter().map(|(name, shape)| {
        let count = shape.lanes().len();
        at += count;
        format!("{name} = {}", shown(&arguments[at - count..at], &row[at - count..at]))
    });
    let named = named.collect::<Vec<_>>().join("; ");
    let (column, baseline) = (request.columns[other.column], request.columns[first.column]);
    format!(
        "at {named} `{column}` returns {}, `{baseline}` {}",
        shown(&results, &actual),
        shown(&results, &expected)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spirv_cross_rejects_nothing_that_spirv_val_accepts() {
        let said = |command: &str, verdict: &str| Said {
            command: command.to_owned(),
            version: String::new(),
            verdict: verdict.to_owned(),
        };
        let (good, bad) =
            (said("spirv-val shader.spv", VALID), said("spirv-cross shader.spv", "no"));
        assert_eq!(rejection(&[good.clone(), bad.clone()]), None);
        assert_eq!(rejection(std::slice::from_ref(&bad)), Some(&bad));
        let val = said("spirv-val shader.spv", "invalid");
        assert_eq!(rejection(&[val.clone(), bad]), Some(&val));
        assert_eq!(rejection(&[good]), None);
    }
}
