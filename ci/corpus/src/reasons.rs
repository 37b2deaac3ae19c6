//! The reasons why functions of published crates can't be called: a complete list, each reason with an explanation.

use std::collections::BTreeMap;
use std::fmt::Write as _;

/// The cause of a limit.
#[derive(Clone, Copy, PartialEq)]
enum Whose {
    /// The shader itself is the cause: no harness could call the function unchanged.
    Nature,
    Karat,
}

use Whose::{Karat, Nature};

/// A reason from the linker or a probe, the cause of the limit, and the explanation.
const ARGUED: &[(&str, Whose, &str)] = &[
    (
        "names of another file",
        Nature,
        "the crate's Rust joins files, or the file is a part that others include",
    ),
    (
        "template",
        Nature,
        "a template engine of the crate's Rust writes the code, with loops over its tensors",
    ),
    ("WGSL of 2021", Nature, "`[[block]]` and `;` between members: naga refuses it today"),
    ("invalid for naga", Nature, "naga's validator refuses it, in the crate's own program, too"),
    (
        "no result",
        Nature,
        "it returns nothing, and writes what ends with the invocation: a call gives nothing to compare",
    ),
    ("unknown preprocessor", Nature, "the crate's Rust has a preprocessor of its own"),
    (
        "included by others",
        Nature,
        "the file is a part that others include, and has no meaning alone",
    ),
    (
        "syntax",
        Karat,
        "naga_oil's `virtual` and `override` functions, which its own tests alone use",
    ),
    ("asset path", Karat, "names out of an asset's path, `#import \"a.wgsl\"::f`"),
    (
        "import not found",
        Karat,
        "modules that a program adds under names of its own, which no file has",
    ),
    (
        "under a condition",
        Karat,
        "the list sets the features of one variant, and the name is another's",
    ),
    ("value of a feature", Karat, "the list gives the feature no value"),
    ("pointer", Karat, "a pointer into a buffer as an argument"),
    ("discards", Karat, "a form of `discard` that isn't wrapped"),
    ("fragment that writes", Karat, "it writes what other pixels see"),
    ("texture as argument", Karat, "a texture or sampler as an argument"),
    ("64 bits", Karat, "numbers of 64 bits"),
    ("runtime array", Karat, "an array without a size as an argument"),
    ("not probed otherwise", Karat, "another form of argument"),
];

/// Checks if the list contains a reason.
pub(crate) fn is_argued(reason: &str) -> bool {
    ARGUED.iter().any(|(known, ..)| *known == reason)
}

/// The share of functions that are callable, or that no harness could call, and each reason with its explanation.
pub(crate) fn told(functions: usize, callable: usize, reasons: &BTreeMap<String, usize>) -> String {
    let of = |whose: Whose| {
        let own = ARGUED.iter().filter(move |(_, known, _)| *known == whose);
        own.filter_map(|(reason, _, why)| {
            let count = reasons.get(*reason).copied().filter(|count| *count > 0)?;
            Some((*reason, count, *why))
        })
    };
    let natural: usize = of(Nature).map(|(_, count, _)| count).sum();
    let share = 100.0 * (callable + natural) as f64 / functions.max(1) as f64;
    let mut text = format!(
        "\n{} of {functions} functions ({share:.1} %) are callable, or refused by nature.\n\n\
         | refused because | functions | whose limit | why |\n|---|---:|---|---|\n",
        callable + natural
    );
    for (whose, name) in [(Nature, "the shader's"), (Karat, "Karat's")] {
        for (reason, count, why) in of(whose) {
            writeln!(text, "| {reason} | {count} | {name} | {why} |").expect("text takes text");
        }
    }
    text
}
