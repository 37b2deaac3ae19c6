//! Runs a row on each column's path, and compares the results.

use std::borrow::Cow;

use karat::fixture::Address;
use karat::path::Path;
use karat::unstable::dispatch::Passes;
use karat::unstable::executor::{self, Caller};
use karat::unstable::fixture::Fixtures;
use karat::unstable::probe::{ProbeError, Probed};
use karat_core::value::Scalar;

use super::compute::{changes, run_entry_point_on_each};
use super::divergence::divergence;
use super::excerpt::function_lines;
use super::execute::{Comparison, Judge, Ran, conclude, not_run};
use super::leeway::{Latitude, Leeway};
use super::reduce::Pair;
use super::subject::{About, Ready};
use super::suspect::{self, Side};
use super::{Allowed, Cell, Request, Row, Status, Stop};
use crate::limits::REPEATED;
use crate::made_up::{self, Content, Ranges};
use crate::work;

/// Runs a row on the columns with a valid translation, and compares the results.
pub(super) fn run(request: &Request, ready: Ready, mut cells: Vec<Cell>) -> Row {
    for cell in &mut cells {
        let entry_point = matches!(ready.about, About::EntryPoint { .. });
        let lines = |text: &str| function_lines(text, ready.name(), entry_point);
        cell.text_lines = cell.text().and_then(lines);
    }
    let mut buffers = Vec::new();
    match &ready.about {
        About::Function(probed) => run_function(request, probed, &mut cells),
        About::EntryPoint { program, name } => match program.compute_entry_point(name) {
            Some((bindings, size)) => {
                let size = size.iter().fold(1, |all: u32, n| all.saturating_mul(*n)).max(1);
                let workgroups = made_up::INVOCATIONS.div_ceil(size);
                let invocations = workgroups.saturating_mul(size) as usize;
                let of = |data: Vec<_>| {
                    let program = std::sync::Arc::clone(program);
                    (Passes::over(program, name, [workgroups, 1, 1], &data), data)
                };
                let made = |content| {
                    Ranges::of(&request.package)
                        .map_err(|error| error.to_string())
                        .and_then(|ranges| {
                            made_up::data(program, &bindings, &ranges, invocations, content)
                        })
                        .map(of)
                };
                // A content shows the pass's effect only if the pass changes a value of the content.
                let shows = |one: &Result<(Passes, _), String>| {
                    one.as_ref().map_or(true, |(passes, _)| changes(passes) != Some(false))
                };
                let mut all = Content::OF_FUNCTIONS.into_iter().map(made);
                let passes = all.find(shows).unwrap_or_else(|| made(Content::OF_FUNCTIONS[0]));
                let ran = passes.as_ref().map(|(passes, _)| passes);
                run_entry_point_on_each(request, ran, &mut cells);
                if let (Ok((_, data)), true) = (passes, cells.iter().any(Cell::differs)) {
                    buffers = data.iter().filter_map(super::Buffer::of).collect();
                }
            }
            // The translation contains the entry point, but Karat runs the entry point as a function.
            None => match request.probed(&ready.row.name) {
                Ok(probed) => run_function(request, &probed, &mut cells),
                Err(error) => {
                    let why = format!("Karat can't call a {} entry point: {error}", ready.row.kind);
                    run_entry_point_on_each(request, Err(&why), &mut cells);
                }
            },
        },
    }
    let text = ready.text().into();
    Row { text, buffers, ..ready.row(cells) }
}

fn run_function(request: &Request, probed: &Probed, cells: &mut [Cell]) {
    let ranges = Ranges::of(&request.package).map_err(|error| error.to_string());
    let drawn = ranges.and_then(|ranges| {
        let fixtures = made_up::fixtures(probed, &ranges, made_up::beyond(probed)[0]);
        // If a resource can't be generated, the error appears where the resource is used.
        let rows = work::rows(probed, &ranges, &fixtures.unwrap_or_default(), request.cases)?;
        Ok((rows, ranges))
    });
    let (rows, ranges) = match drawn {
        Ok(drawn) => drawn,
        // Only a declared range can contain no value of the type.
        Err(why) => {
            for cell in cells.iter_mut().filter(|cell| cell.stopped.is_none()) {
                cell.stopped = Some(Stop::Broke(why.clone()));
            }
            return;
        }
    };
    let (before, all) = (cells.to_vec(), made_up::beyond(probed));
    let width = rows.len() / request.cases;
    let parameters = &probed.function.parameters;
    let scalars: Vec<Scalar> = parameters.iter().flat_map(|(_, shape)| shape.lanes()).collect();
    let row = |at: usize| &rows[at * width..][..width];
    let is_near = |at: usize| {
        let floats = row(at).iter().zip(&scalars).filter(|(_, scalar)| scalar.is_float());
        floats.into_iter().all(|(word, scalar)| scalar.decode(*word).abs() <= REPEATED)
    };
    for (part, beyond) in all.iter().enumerate().take(request.cases) {
        let of_part = |at: &usize| {
            let clamps = all.iter().position(|one| *one == Address::Clamp);
            let far = clamps.filter(|_| !is_near(*at));
            far.unwrap_or(at % all.len()) == part
        };
        let own: Vec<usize> = (0..request.cases).filter(of_part).collect();
        let cases = own.len();
        if cases == 0 {
            continue;
        }
        let rows: Vec<u32> = own.into_iter().flat_map(row).copied().collect();
        let fixtures = made_up::fixtures(probed, &ranges, *beyond);
        let mut found = before.clone();
        run_cases(request, probed, (&rows, cases), (fixtures, *beyond), &mut found);
        for (cell, found) in cells.iter_mut().zip(found) {
            if part == 0 { *cell = found } else { cell.add(found) }
        }
    }
}

impl Cell {
    /// Adds the result of other cases of the same function. The worse verdict counts.
    fn add(&mut self, other: Self) {
        let worst = self.worst_ulp.max(other.worst_ulp);
        let counts = [self.compared, self.differing, self.open];
        let counts =
            [counts[0] + other.compared, counts[1] + other.differing, counts[2] + other.open];
        let allowed = match (self.allowed.take(), other.allowed.clone()) {
            (Some(one), Some(more)) => Some(one.and(more)),
            (one, more) => one.or(more),
        };
        let weight = |cell: &Self| match &cell.stopped {
            Some(stop) if stop.is_wrong() => 3,
            None => 2,
            Some(Stop::NothingToCompare(_)) => 1,
            Some(_) => 2,
        };
        if weight(&other) > weight(self) {
            *self = other;
        }
        [self.compared, self.differing, self.open] = counts;
        (self.worst_ulp, self.allowed) = (worst, allowed);
    }
}

fn run_cases(
    request: &Request,
    probed: &Probed,
    (rows, cases): (&[u32], usize),
    (fixtures, beyond): (Result<Fixtures, String>, Address),
    cells: &mut [Cell],
) {
    let mut ran: Vec<Ran<'_>> = Vec::new();
    // If the function doesn't end on one driver, it would hang other drivers.
    let mut endless: Option<String> = None;
    for (index, column) in request.columns.iter().enumerate() {
        let cell = &mut cells[index];
        if cell.stopped.is_some() {
            continue;
        }
        let results = match (&fixtures, column.path, &endless) {
            (_, None, _) => Err(Stop::Unavailable(column.without_path())),
            (Err(why), ..) | (_, _, Some(why)) => Err(Stop::NotRun(why.clone())),
            (Ok(fixtures), Some(path), None) => {
                results(path, (probed, fixtures), (rows, cases), &mut endless)
            }
        };
        match results {
            Ok((caller, results)) => {
                cell.status = Some(Status::Executed);
                ran.push(Ran { column: index, caller, results });
            }
            Err(stop) => cell.stopped = Some(stop),
        }
    }
    let (Ok(fixtures), false) = (&fixtures, ran.is_empty()) else { return };
    let leeway = Leeway::of(probed, fixtures);
    let latitude = leeway.at(rows, cases);
    if let Some(bounds) = latitude.as_ref().and_then(|latitude| latitude.bounds.as_ref()) {
        for ran in &ran {
            cells[ran.column].allowed = Some(Allowed::of(probed, rows, bounds, &ran.results));
        }
    }
    compare_all(request, probed, rows, &ran, (&leeway, latitude.as_ref(), beyond), cells);
}

fn results<'p>(
    path: Path,
    (probed, fixtures): (&'p Probed, &'p Fixtures),
    (rows, cases): (&[u32], usize),
    endless: &mut Option<String>,
) -> Result<(Caller<'p>, Vec<u32>), Stop> {
    // An unavailable path and a function that can't run on a path have different reasons.
    karat::unstable::path::adapter(path).map_err(|error| Stop::Unavailable(error.to_string()))?;
    let mut stop = |error: ProbeError| {
        if let ProbeError::Rounds { .. } = error {
            *endless = Some(format!(
                "on `{path}`, one of the function's loops doesn't end for these inputs"
            ));
        }
        Stop::NotRun(not_run(error))
    };
    let executor = executor::of(path).map_err(ProbeError::from).map_err(&mut stop)?;
    let caller = Caller::new(executor, Cow::Borrowed(probed), fixtures, cases);
    let caller = caller.map_err(&mut stop)?;
    let results = caller.results(rows, cases).map_err(stop)?;
    Ok((caller, results))
}

/// Compares each column with the first column that ran.
fn compare_all(
    request: &Request,
    probed: &Probed,
    rows: &[u32],
    ran: &[Ran<'_>],
    (leeway, latitude, beyond): (&Leeway, Option<&Latitude>, Address),
    cells: &mut [Cell],
) {
    let function = probed.function();
    let results = function.result.lanes();
    let arguments: Vec<Scalar> =
        function.parameters.iter().flat_map(|(_, shape)| shape.lanes()).collect();
    let [first, others @ ..] = ran else { return };
    let judge = Judge::new(&results, &request.within, &first.results);
    let ranges = Ranges::of(&request.package).expect("the inputs were made from these ranges");
    let inputs = made_up::Arguments::of(function, &ranges).expect("the inputs exist");
    let mut agreeing: Option<Comparison> = None;
    for other in others {
        let pair = Pair {
            expected: &first.caller,
            actual: &other.caller,
            inputs: &inputs.domain,
            arguments: &arguments,
            results: &results,
            judge: &judge,
            leeway,
        };
        let seen = pair.compare(rows, [&first.results, &other.results], latitude);
        let baseline = request.columns[first.column];
        let cell = &mut cells[other.column];
        cell.against = Some(baseline.to_string());
        (cell.compared, cell.differing, cell.worst_ulp) =
            (seen.compared, seen.differing.len(), seen.worst_ulp);
        cell.open = seen.open;
        if seen.compared == 0 {
            let none = match latitude {
                Some(_) => "WGSL doesn't define the result of any case",
                None => "no case has a finite result",
            };
            cell.stopped = Some(Stop::NothingToCompare(none.to_owned()));
        } else if let Some(case) = seen.differing.first() {
            let text = cell.text().zip(cell.text_lines);
            let found =
                divergence(request, probed, rows, (first, other), *case, (&pair, beyond), text);
            let (count, compared) = (seen.differing.len(), seen.compared);
            let sampled = match beyond {
                Address::Clamp => "",
                Address::Repeat => " where samplers repeat",
                Address::Mirror => " where samplers mirror",
            };
            cell.stopped = Some(Stop::Differs(format!(
                "{count} of {compared} cases differ from `{baseline}`{sampled}: {}",
                found.sentence(&request.columns[other.column].to_string())
            )));
            cell.divergence = Some(found);
            let width = results.len();
            let of = |ran: &Ran<'_>| ran.results[case * width..(case + 1) * width].to_vec();
            let (was, is) = (of(first), of(other));
            // Compares a column with one of the two columns, by the rule that compared the two with each other.
            let agrees = |one: &[u32], with: &[u32]| {
                let latitude = latitude.map(|all| all.case(*case, width));
                !judge.case(with, one, latitude).differs
            };
            let side = |ran: &Ran<'_>| {
                let own = of(ran);
                let side = match (agrees(&own, &was), agrees(&own, &is)) {
                    (true, false) => Side::First,
                    (false, true) => Side::Other,
                    _ => Side::Neither,
                };
                (request.columns[ran.column].to_string(), side)
            };
            suspect::name(cell, &ran.iter().map(side).collect::<Vec<_>>());
        } else {
            cell.status = Some(Status::Agrees);
            agreeing.get_or_insert(seen);
        }
    }
    conclude(&mut cells[first.column], agreeing, others.len());
}

#[cfg(test)]
mod tests {
    use super::super::{Matrix, Status};
    use super::*;
    use karat::Package;

    /// The matrix of those columns that are available on this machine.
    fn matrix(text: &str, columns: &[&str]) -> Matrix {
        let columns =
            columns.iter().map(|name| name.parse::<super::super::Column>().expect("a column"));
        let here = columns.filter(|one| {
            one.path().is_some_and(|path| karat::unstable::path::adapter(path).is_ok())
        });
        crate::matrix(&Package::from_source("m", text))
            .columns(here)
            .run()
            .expect("the matrix is made")
    }

    fn others(matrix: &Matrix) -> impl Iterator<Item = (&str, &Cell)> {
        matrix.rows.iter().flat_map(|row| row.cells.iter().skip(1).map(|cell| (&*row.name, cell)))
    }

    #[test]
    fn branches_on_a_subnormal_are_open() {
        let text = "
            @group(0) @binding(0) var image: texture_2d<f32>;
            @group(0) @binding(1) var linear: sampler;
            @fragment fn cut(@location(0) alpha: f32) -> @location(0) vec4f {
                if alpha > 0.0 { discard; }
                return vec4f(0.5);
            }
            @fragment fn derived(@location(0) alpha: f32) -> @location(0) vec4f {
                if alpha > 0.0 { discard; }
                return vec4f(0.5 + dpdx(alpha));
            }
            @fragment fn sampled(@location(0) alpha: f32, @location(1) uv: vec2f) -> @location(0) vec4f {
                let texel = textureSample(image, linear, uv);
                if alpha * texel.w > 0.0 { discard; }
                return texel;
            }
            fn whole(alpha: f32) -> i32 { return select(3, 7, alpha > 0.0) + i32(dpdx(alpha)); }
            fn scaled(alpha: f32) -> f32 { return alpha * 1e38 + dpdx(alpha); }";
        let made = matrix(text, &["cpu", "cpu:ftz", "vulkan", "gl"]);
        let mut open = 0;
        for (name, cell) in others(&made) {
            assert_eq!(cell.status, Some(Status::Agrees), "{name}: {:?}", cell.stopped);
            open += cell.open;
        }
        assert!(open > 0, "subnormal numbers are sampled");
    }

    #[test]
    fn results_within_the_wgsl_bound_agree() {
        // In GL's `mix`, terms cancel. They also cancel in the distance to a near point.
        let text = "
            fn blend(p: f32, q: f32, h: f32) -> f32 { return mix(p, q, clamp(h, 0.0, 1.0)); }
            fn union_of(p: f32, q: f32) -> f32 {
                let h = clamp(0.5 + 0.5 * (q - p) / 0.05, 0.0, 1.0);
                return mix(q, p, h) - 0.05 * h * (1.0 - h);
            }
            fn part(p: vec2f) -> f32 { return fract(sin(dot(p, vec2f(12.9898, 78.233))) * 43758.5453); }";
        for (name, cell) in others(&matrix(text, &["cpu", "cpu:fma", "vulkan", "gl"])) {
            assert_eq!(cell.status, Some(Status::Agrees), "{name}: {:?}", cell.stopped);
            assert_eq!(cell.differing, 0, "{name}");
        }
    }

    /// With a repeating sampler, naga's GLSL for `textureSampleBaseClampToEdge` doesn't clamp the coordinates.
    // Lesson 86
    #[test]
    fn samplers_clamp_repeat_and_mirror() {
        let sampled = |name: &str, call: &str| {
            format!(
                "@group(0) @binding(0) var image: texture_2d<f32>; @group(0) @binding(1) var {name}: sampler;
                 fn frame(uv: vec2f) -> vec4f {{ return {call}; }}"
            )
        };
        let paths = ["cpu", "vulkan", "gl"];
        for name in ["repeating", "s", "linear"] {
            let clamped =
                sampled(name, &format!("textureSampleBaseClampToEdge(image, {name}, uv)"));
            let made = matrix(&clamped, &paths);
            for (column, cell) in made.rows[0].cells.iter().enumerate().skip(1) {
                let is_gl = made.columns[column].name == "gl";
                assert_eq!(cell.differs(), is_gl, "{name}: {:?}", cell.stopped);
                let said = cell.stopped.as_ref().map_or("", Stop::text);
                assert_eq!(said.contains("where samplers repeat"), is_gl, "{said}");
                // The two other columns agree, so GL is the suspect.
                let suspect = (is_gl && made.columns.len() == 3).then_some("gl");
                assert_eq!(cell.suspect.as_deref(), suspect, "{said}");
            }
            let plain =
                sampled(name, &format!("textureSampleLevel(image, {name}, 3.0 * uv - 1.0, 0.0)"));
            for (_, cell) in others(&matrix(&plain, &paths)) {
                assert_eq!(cell.status, Some(Status::Agrees), "{:?}", cell.stopped);
                assert_eq!(cell.compared, 512, "each case has one address mode");
            }
        }
    }
}
