//! Helpers that call WGSL functions with rows of arguments.
use karat_engine::{
    F32, F64, Interval, Intervals, Lane, Options, Program, Resources, Runs, Settings,
};

pub(crate) fn module(source: &str) -> (naga::Module, naga::valid::ModuleInfo) {
    let module = match naga::front::wgsl::parse_str(source) {
        Ok(module) => module,
        Err(error) => panic!("{}", error.emit_to_string(source)),
    };
    let mut validator = naga::valid::Validator::new(
        naga::valid::ValidationFlags::all(),
        naga::valid::Capabilities::all(),
    );
    let info = match validator.validate(&module) {
        Ok(info) => info,
        Err(error) => panic!("{}", error.emit_to_string(source)),
    };
    (module, info)
}

pub(crate) fn program(source: &str, name: &str) -> Program {
    let (module, info) = module(source);
    Program::function(&module, &info, name, &Settings::default()).expect("it lowers")
}

/// Calls the function `f` of a WGSL source. `rows` and the result have the bits of each scalar as a `u32`.
pub(crate) fn words(source: &str, rows: &[u32]) -> Vec<u32> {
    let program = program(source, "f");
    let cases = rows.len() / program.parameters().len().max(1);
    call::<F32>(&program, cases, rows).words()
}

pub(crate) fn call<A: Runs>(
    program: &Program,
    cases: usize,
    rows: &[u32],
) -> karat_engine::Results<A> {
    program.call::<A>(cases, rows, &Resources::new(), &Options::default(), &()).expect("it runs")
}

/// Calls the function `f` in `f32` arithmetic, with float arguments and float results.
pub(crate) fn floats(source: &str, rows: &[f32]) -> Vec<f32> {
    let rows: Vec<u32> = rows.iter().map(|x| x.to_bits()).collect();
    words(source, &rows).into_iter().map(f32::from_bits).collect()
}

/// Calls the function `f` in `f64` arithmetic, with float arguments and float results.
pub(crate) fn doubles(source: &str, rows: &[f32]) -> Vec<f64> {
    let rows: Vec<u32> = rows.iter().map(|x| x.to_bits()).collect();
    let program = program(source, "f");
    let cases = rows.len() / program.parameters().len().max(1);
    let results = call::<F64>(&program, cases, &rows);
    (0..cases)
        .flat_map(|case| results.row(case))
        .map(|lane| match lane {
            Lane::Float(x) => x,
            other => panic!("{other:?}"),
        })
        .collect()
}

/// Calls the function `f` in interval arithmetic. Each argument is an interval of one float.
pub(crate) fn intervals(source: &str, rows: &[f32]) -> Vec<Interval> {
    let rows: Vec<u32> = rows.iter().map(|x| x.to_bits()).collect();
    let program = program(source, "f");
    let cases = rows.len() / program.parameters().len().max(1);
    let results = call::<Intervals>(&program, cases, &rows);
    (0..cases)
        .flat_map(|case| results.row(case))
        .map(|lane| match lane {
            Lane::Float(x) => x,
            other => panic!("{other:?}"),
        })
        .collect()
}
