//! The reasons why Karat can't call functions of published crates, each with an explanation. The program `corpus`
//! reports each reason that is missing here.

use std::collections::BTreeMap;
use std::fmt::Write as _;

/// The side that would have to change so that Karat can call a function: the shader or Karat.
#[derive(Clone, Copy, PartialEq)]
enum Whose {
    /// The shader itself is the cause: no harness could call the function without a change to the shader.
    Nature,
    Karat,
}

use Whose::{Karat, Nature};

/// Each reason why Karat refuses a function, with the side that would have to change, and an explanation.
const ARGUED: &[(&str, Whose, &str)] = &[
    (
        "names of another file",
        Nature,
        "the crate's Rust code joins files, or other files include the file",
    ),
    (
        "template",
        Nature,
        "a template engine in the crate's Rust code writes the WGSL, with loops over tensors",
    ),
    (
        "WGSL of 2021",
        Nature,
        "the shader has `[[block]]` or `;` between members, which today's naga rejects",
    ),
    (
        "invalid for naga",
        Nature,
        "naga's validator rejects the shader, in the crate's own program, too",
    ),
    (
        "no result",
        Nature,
        "the function returns nothing, and writes only variables that end with the invocation: Karat has no result to compare",
    ),
    ("unknown preprocessor", Nature, "the crate's Rust code has its own preprocessor"),
    (
        "included by others",
        Nature,
        "other files include the file, and the file isn't valid without them",
    ),
    (
        "syntax",
        Karat,
        "the shader has `virtual` or `override` functions of naga_oil, which only naga_oil's tests use",
    ),
    ("asset path", Karat, "the shader imports a name by an asset's path, `#import \"a.wgsl\"::f`"),
    (
        "import not found",
        Karat,
        "the shader imports a module that a program adds under a name that no file has",
    ),
    (
        "under a condition",
        Karat,
        "the list sets the features of one variant, and the function is in another variant",
    ),
    ("value of a feature", Karat, "the list doesn't give the feature a value"),
    ("pointer", Karat, "an argument is a pointer into a buffer"),
    ("discards", Karat, "the function has a form of `discard` that Karat doesn't support"),
    ("fragment that writes", Karat, "the function writes data that other pixels read"),
    ("texture as argument", Karat, "an argument is a texture or a sampler"),
    ("64 bits", Karat, "the function has 64-bit numbers"),
    ("runtime array", Karat, "an argument is an array without a size"),
    ("not probed otherwise", Karat, "an argument has another form that Karat doesn't support"),
];

/// Checks if the list explains a reason.
pub(crate) fn is_argued(reason: &str) -> bool {
    ARGUED.iter().any(|(known, ..)| *known == reason)
}

/// Returns the end of the report: the share of functions that Karat either can call, or can't call because of the
/// shader itself, and a table that explains each reason.
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
        "\n{} of {functions} functions ({share:.1} %) are callable, or refused because of the shader.\n\n\
         | refused because | functions | limit of | why |\n|---|---:|---|---|\n",
        callable + natural
    );
    for (whose, name) in [(Nature, "the shader"), (Karat, "Karat")] {
        for (reason, count, why) in of(whose) {
            writeln!(text, "| {reason} | {count} | {name} | {why} |").expect("text takes text");
        }
    }
    text
}
