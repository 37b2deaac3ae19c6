//! The result of linking.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use super::depth::deepest;
use super::lexer::lex;
use super::library::{ModulePath, Sources};
use super::splice::Spliced;
use super::stage::Stage;
use crate::diagnostic::{SourceFile, Span};

/// WGSL's names that generated kernels use. If a shader under test declares such a name, the linker renames the
/// declaration.
pub(crate) const KERNEL_WORDS: &[&str] = &[
    "all",
    "array",
    "arrayLength",
    "bitcast",
    "bool",
    "f16",
    "f32",
    "global_invocation_id",
    "i32",
    "mat2x2",
    "mat2x3",
    "mat2x4",
    "mat3x2",
    "mat3x3",
    "mat3x4",
    "mat4x2",
    "mat4x3",
    "mat4x4",
    "min",
    "private",
    "read",
    "read_write",
    "select",
    "storage",
    "u32",
    "uniform",
    "vec2",
    "vec3",
    "vec4",
];

/// The prefix of names in generated kernels.
pub(crate) const KERNEL_PREFIX: &str = "karat_";

/// Replaces the tokens that naga doesn't know by blanks.
pub(crate) fn as_naga_takes(text: &str) -> Cow<'_, str> {
    let unknown = unknown_to_naga(text);
    if unknown.is_empty() {
        return text.into();
    }
    let mut bytes = text.as_bytes().to_vec();
    unknown.into_iter().for_each(|range| bytes[range].fill(b' '));
    String::from_utf8(bytes).map_or(text.into(), Cow::Owned)
}

/// The tokens of `enable subgroups;`, which naga doesn't know. WGSL requires this directive for subgroup operations
/// (4.1.1), but naga accepts the operations without the directive.
pub(crate) fn unknown_to_naga(text: &str) -> Vec<Range<usize>> {
    const KNOWN: &str = "subgroups";
    let mut unknown = Vec::new();
    if !text.contains(KNOWN) {
        return unknown;
    }
    let tokens = lex(text);
    let is =
        |at: usize, word: &str| tokens.get(at).is_some_and(|token| &text[token.range()] == word);
    let mut add = |at: usize| unknown.push(tokens[at].range());
    // Directives come before everything else (WGSL, 4).
    let mut start = 0;
    while ["enable", "requires", "diagnostic"].iter().any(|word| is(start, word)) {
        let Some(end) = (start..tokens.len()).find(|at| is(*at, ";")) else { break };
        let extensions: Vec<usize> = (start + 1..end).filter(|at| !is(*at, ",")).collect();
        let is_known = |at: &usize| is(*at, KNOWN);
        if is(start, "enable") && extensions.iter().all(is_known) {
            (start..=end).for_each(&mut add);
        } else if is(start, "enable") {
            for at in extensions.into_iter().filter(is_known) {
                add(at);
                // Also removes the comma after the extension, or else the comma before it.
                [at + 1, at - 1].into_iter().find(|at| is(*at, ",")).into_iter().for_each(&mut add);
            }
        }
        start = end + 1;
    }
    unknown
}

/// WGSL without imports, with a map to positions in the author's files.
#[derive(Clone, Debug)]
pub(crate) struct Linked {
    pub(crate) spliced: Spliced,
    /// For each declaration's name in the text, the declaration's path in the author's code: `fresnel::schlick`.
    pub(crate) names: BTreeMap<String, String>,
    /// The file of the linked module.
    pub(crate) file: Arc<SourceFile>,
    /// `true` if the text has everything that the file declares, except tests. If the whole text is valid, then the
    /// file is also valid.
    pub(crate) whole: bool,
    /// The linked function, if it is an entry point in the author's code.
    pub(crate) called: Option<EntryPoint>,
    /// For a function with `discard`: its name in the text, and the name of the generated function that Karat calls
    /// instead.
    pub(crate) discards: Option<(String, &'static str)>,
    /// For each number that Karat adds to a call of an expectation, the location of the call.
    pub(crate) calls: BTreeMap<u32, Span>,
    pub(crate) inactive: BTreeMap<String, Unmet>,
    pub(crate) sources: Sources,
}

#[derive(Clone, Debug)]
pub(crate) struct Unmet {
    /// The condition in the author's text: `@if(fast)`.
    pub(crate) condition: String,
    /// The feature's name, if the condition is only a name: `fast` for `@if(fast)`. Otherwise `None`.
    pub(crate) feature: Option<String>,
}

/// An entry point without its attributes, so that a kernel can call it.
#[derive(Clone, Debug)]
pub(crate) struct EntryPoint {
    pub(crate) stage: Stage,
    /// The name and the builtin value of each parameter with `@builtin`, such as `id` and `global_invocation_id`.
    pub(crate) builtins: Vec<(String, String)>,
}

impl Linked {
    pub(crate) fn text(&self) -> &str {
        self.spliced.text()
    }

    /// Checks if one of the text's `enable` directives lists this extension.
    pub(crate) fn enables(&self, extension: &str) -> bool {
        let text = self.text();
        if !text.contains(extension) {
            return false;
        }
        let tokens = lex(text);
        let words: Vec<&str> = tokens.iter().map(|token| &text[token.range()]).collect();
        let mut statements = words.split(|word| *word == ";");
        statements.any(|one| one.first() == Some(&"enable") && one.contains(&extension))
    }

    /// The location at which the text nests too deeply, or has too long an expression: a compiler would overflow its
    /// stack. Returns `None` if there is no such location. Compilers recurse over nested blocks and over the terms of
    /// an expression.
    pub(crate) fn too_deep(&self) -> Option<Span> {
        let place = deepest(self.text())?;
        let none = || Span { file: Arc::clone(&self.file), range: 0..0 };
        Some(self.spliced.resolve(place).unwrap_or_else(none))
    }

    /// The name of a declaration in the linked text. `path` is the declaration's path in the author's code:
    /// `fresnel::schlick`.
    pub(crate) fn name_of(&self, path: &str) -> Option<&str> {
        self.names.iter().find(|(_, known)| *known == path).map(|(name, _)| name.as_str())
    }
}

pub(super) type Item = (ModulePath, usize);

/// An item's path for messages: `fresnel::schlick` in this package, `noise::value::perlin` in a dependency.
pub(super) fn author_path(route: &str, module: &ModulePath, item: &str) -> String {
    let route = (!route.is_empty()).then(|| route.to_owned());
    let parts: Vec<String> = route
        .into_iter()
        .chain(module.components.iter().cloned())
        .chain([item.to_owned()])
        .collect();
    parts.join("::")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn naga_takes_subgroups_without_their_directive() {
        for (text, taken) in [
            ("enable subgroups;\nfn f() {}", "                 \nfn f() {}"),
            ("enable f16, subgroups;fn f() {}", "enable f16           ;fn f() {}"),
            ("enable subgroups, f16 ;", "enable            f16 ;"),
            ("// enable subgroups;\nfn subgroups() {}", "// enable subgroups;\nfn subgroups() {}"),
            ("requires a; enable subgroups ;", "requires a;                   "),
            ("fn f() {} enable subgroups;", "fn f() {} enable subgroups;"),
        ] {
            assert_eq!(as_naga_takes(text), taken);
        }
    }
}
