//! Lists the functions of a WGSL file that the engine can execute. For each function that the engine can't execute,
//! prints the reason.
//!
//! `cargo run --example survey -- file.wgsl` lowers each function, and calls each lowered function with 64 rows of
//! generated arguments, in `f32`, in `f64` and in intervals. The program lowers compute entry points, but doesn't run
//! them.
#![expect(clippy::print_stdout, reason = "a program for the terminal")]

use karat_engine::{F32, F64, Intervals, Options, Program, Resources, Scalar, Settings, Stop};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut good = 0;
    let mut all = 0;
    let mut ran = 0;
    for path in std::env::args().skip(1) {
        let source = std::fs::read_to_string(&path)?;
        let module = naga::front::wgsl::parse_str(&source)
            .map_err(|error| error.emit_to_string_with_path(&source, &path))?;
        let info = naga::valid::Validator::new(
            naga::valid::ValidationFlags::all(),
            naga::valid::Capabilities::all(),
        )
        .validate(&module)
        .map_err(|error| error.emit_to_string_with_path(&source, &path))?;
        for (_, function) in module.functions.iter() {
            let name = function.name.clone().unwrap_or_default();
            all += 1;
            match Program::function(&module, &info, &name, &Settings::default()) {
                Ok(program) => {
                    good += 1;
                    let outcome = run(&program);
                    ran += usize::from(outcome.is_ok());
                    println!("{name}: {:?}, {outcome:?}", program.size());
                }
                Err(refusal) => {
                    let line = refusal.span.location(&source).line_number;
                    println!("{name}: {refusal} (line {line})");
                }
            }
        }
        for point in &module.entry_points {
            match Program::entry_point(&module, &info, &point.name, &Settings::default()) {
                Ok(program) => println!("entry point {}: {:?}", point.name, program.size()),
                Err(refusal) => println!("entry point {}: {refusal}", point.name),
            }
        }
    }
    println!("{good} of {all} functions can be lowered, {ran} run without resources");
    Ok(())
}

fn run(program: &Program) -> Result<usize, Stop> {
    let parameters = program.parameters();
    let mut rows = Vec::new();
    for case in 0..64u32 {
        for (k, scalar) in parameters.iter().enumerate() {
            let share = f64::from((case * 31 + k as u32 * 17) % 64) / 64.0;
            rows.push(match scalar {
                Scalar::F32 => (share as f32).to_bits(),
                Scalar::F16 => 0x3800,
                Scalar::I32 | Scalar::U32 => (share * 8.0) as u32,
                Scalar::Bool => case & 1,
            });
        }
    }
    let (resources, options) = (Resources::new(), Options::default());
    program.call::<F32>(64, &rows, &resources, &options, &())?;
    program.call::<F64>(64, &rows, &resources, &options, &())?;
    let bounds = program.call::<Intervals>(64, &rows, &resources, &options, &())?;
    let bounded = (0..64).filter(|&case| {
        bounds.row(case).iter().all(|lane| match lane {
            karat_engine::Lane::Float(interval) => interval.is_bounded(),
            _ => true,
        })
    });
    Ok(bounded.count())
}
