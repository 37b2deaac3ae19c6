use super::*;
use crate::package::Package;
use crate::probe::evidence;

fn probed(change: impl Fn(String) -> String) -> Probed {
    let package = Package::from_source("s", "fn f(x: f32) -> f32 { return x + 1.0; }");
    let mut probed = Probed::new(&package, "f").expect("a valid function");
    probed.kernel.text = change(probed.kernel.text);
    probed
}

fn run(probed: &Probed, cases: usize) -> Vec<Result<usize, ProbeError>> {
    let devices = crate::path::chosen()
        .expect("a path opens")
        .into_iter()
        .filter_map(crate::path::Opened::device);
    let run = |device| {
        let runner = Runner::new(device, probed, &Vec::new(), cases)?;
        let arguments: Vec<u32> = (0..cases).map(|i| (i as f32).to_bits()).collect();
        let dispatch = runner.dispatch(cases, &arguments, 0x1234_5678)?;
        runner.dispatcher.read(dispatch, |words| {
            let right = |(i, case): &(usize, &[u32])| case[0] == (*i as f32 + 1.0).to_bits();
            words.chunks_exact(runner.dispatcher.stride_out()).enumerate().filter(right).count()
        })
    };
    devices.into_iter().map(run).collect()
}

// Lesson 13
#[test]
fn each_case_of_a_batch_is_computed_at_any_size() {
    for cases in [1, 63, 64, 65, 1000, BATCH] {
        for computed in run(&probed(|text| text), cases) {
            assert_eq!(computed.expect("runs"), cases);
        }
    }
}

/// The kernel returns before it writes, so the results are poison. Karat must report an error instead of a verdict.
// Lesson 6
#[test]
fn a_kernel_that_never_writes_is_an_error() {
    let guard = "if karat_case >= karat_batch.x { return; }";
    let silent = probed(|text| text.replace(guard, "if karat_batch.x >= 0u { return; }"));
    for result in run(&silent, 1000) {
        let error = result.expect_err("nothing was written");
        let found = matches!(error, ProbeError::NotWritten { count: 1000, cases: 1000, .. });
        assert!(found, "{error}");
    }
}

/// The kernel skips one of 1000 cases. Karat must report which case has no result.
// Lesson 6
#[test]
fn one_unwritten_case_is_an_error() {
    let guard = "if karat_case >= karat_batch.x { return; }";
    let skipping = "if karat_case >= karat_batch.x || karat_case == 777u { return; }";
    for result in run(&probed(|text| text.replace(guard, skipping)), 1000) {
        let error = result.expect_err("case 777 was not written");
        assert!(matches!(error, ProbeError::NotWritten { first: 777, count: 1, .. }), "{error}");
    }
}

/// The kernel writes the canary but not the results, as one driver did. In the first kernel, all cases lack a
/// result. In the second kernel, only one case does.
// Lesson 69
#[test]
fn a_kernel_that_writes_only_its_canary_is_an_error() {
    let result = "karat_out[karat_to + 0u] = bitcast<u32>(karat_r);";
    for (guard, first, count) in [("false", 0, 1000), ("karat_case != 777u", 777, 1)] {
        let guarded = format!("if {guard} {{ {result} }}");
        let silent = probed(|text| {
            assert!(text.contains(result), "{text}");
            text.replace(result, &guarded)
        });
        for result in run(&silent, 1000) {
            let error = result.expect_err("a result was not written");
            let ProbeError::ResultNotWritten { first: found, count: counted, .. } = &error else {
                panic!("{error}")
            };
            assert_eq!((*found, *counted), (first, count), "{error}");
        }
    }
}

/// If a function returns exactly the poison, Karat must not report an unwritten result.
// Lesson 69
#[test]
fn a_result_that_equals_the_poison_is_a_result() {
    let wgsl = format!("fn f(x: u32) -> u32 {{ return x ^ {}u; }}", evidence::WORD);
    let package = Package::from_source("s", &wgsl);
    for inputs in Inputs::ALL {
        let probed = Probed::new(&package, "f").and_then(|probed| probed.with_inputs(inputs));
        let probed = probed.expect("a valid function");
        for device in crate::path::chosen()
            .expect("a path opens")
            .into_iter()
            .filter_map(crate::path::Opened::device)
        {
            let runner = Runner::new(device, &probed, &Vec::new(), 8).expect("it compiles");
            let arguments: Vec<u32> = (0..8).collect();
            let dispatch = runner.dispatch(8, &arguments, 0x1234_5678).expect("it runs");
            let results = runner.dispatcher.read(dispatch, |words| {
                words.chunks_exact(2).map(|case| case[0]).collect::<Vec<_>>()
            });
            let expected: Vec<u32> = (0..8).map(|x| x ^ evidence::WORD).collect();
            assert_eq!(results.expect("each is written"), expected, "{inputs}");
        }
    }
}

/// The results of another dispatch have the right length but the wrong canary.
// Lesson 6
#[test]
fn a_stale_canary_is_an_error() {
    let stale = probed(|text| text.replace("karat_batch.y ^ karat_case", "karat_case"));
    for result in run(&stale, 100) {
        assert!(matches!(result, Err(ProbeError::NotWritten { count: 100, .. })));
    }
}

/// GL's driver serves one thread at a time. While another thread uses the driver, a probe must not call the driver, not
/// even to release resources. Other drivers serve several threads at once.
#[test]
fn threads_take_turns_on_gl() {
    use std::sync::mpsc::channel;
    use std::time::Duration;
    for device in crate::path::chosen()
        .expect("a path opens")
        .into_iter()
        .filter_map(crate::path::Opened::device)
    {
        let probed = probed(|text| text);
        let turn = device.turn();
        let (sender, done) = channel();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let ran = Runner::new(device, &probed, &Vec::new(), 1);
                sender.send(ran.is_ok()).expect("somebody listens");
            });
            let early = done.recv_timeout(Duration::from_millis(300));
            let serial = device.path() == crate::path::Path::GL;
            assert!(!serial || early.is_err(), "it didn't wait for its turn");
            drop(turn);
            let late = early.or_else(|_| done.recv_timeout(Duration::from_secs(60)));
            assert_eq!(late, Ok(true), "on {}", device.path());
        });
        assert!(run(&probed, 1).into_iter().all(|ran| ran.is_ok()));
    }
}
