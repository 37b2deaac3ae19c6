//! Reads the values of a function's let-bindings on a driver.
//!
//! In a copy of the linked text, Karat adds a statement that stores the value of one `let` in a private variable. Karat
//! also adds a function that calls the author's function, and then returns this variable. So the author's function runs
//! with its usual control flow, arguments and resources. For a binding in a loop, the variable has the last value.

use std::collections::BTreeMap;

use super::Probed;
use crate::diagnostic::Span;
use crate::package::{LetStatement, Package, let_statements};

/// A let-binding.
pub struct Let {
    /// The binding's name.
    pub name: String,
    /// The position of the name in the source file.
    pub span: Option<Span>,
    /// `true` if the binding is in a loop. The binding's probe then returns the last value of the binding.
    pub repeats: bool,
    /// The index of the binding among the function's bindings with the same name, and the number of bindings with that
    /// name.
    pub of_name: (usize, usize),
    /// A probe that returns the binding's value. The probe takes the same arguments as the function. `None` for a
    /// pointer, for a binding in the head of a `for`, and for bindings after the first `MOST`.
    pub probed: Option<Probed>,
}

/// The largest number of bindings of a function that get a probe. There is a limit because Karat compiles each probe
/// for each path that it compares.
const MOST: usize = 48;

/// The let-bindings of a function, in the order of the text.
pub fn lets(probed: &Probed) -> Vec<Let> {
    let (program, text) = (&probed.program, probed.program.text());
    let path = &probed.function().name;
    let statements = let_statements(text, program.name_of(path));
    let types = types(text, program.name_of(path), &statements);
    let name = |one: &LetStatement| &text[one.name.clone()];
    let probe = |index: usize, one: &LetStatement| {
        let ty = types.get(&index).filter(|_| index < MOST)?;
        copy_that_returns(probed, one, ty)
    };
    let each = statements.iter().enumerate().map(|(index, one)| {
        let same = |other: &&LetStatement| name(other) == name(one);
        Let {
            name: name(one).to_owned(),
            span: program.resolve(one.name.clone()),
            repeats: one.repeats,
            of_name: (
                statements[..index].iter().filter(same).count(),
                statements.iter().filter(same).count(),
            ),
            probed: probe(index, one),
        }
    });
    each.collect()
}

/// The types of the bindings. Karat adds a `var` with the same value after each binding, and naga infers the type of
/// the `var`. The result omits bindings whose values no variable can store, such as pointers.
fn types(text: &str, function: &str, statements: &[LetStatement]) -> BTreeMap<usize, String> {
    let all: Vec<usize> = (0..statements.len()).collect();
    types_of(text, function, statements, &all).unwrap_or_else(|| {
        let alone = |index| types_of(text, function, statements, &[index]).unwrap_or_default();
        all.into_iter().flat_map(alone).collect()
    })
}

fn types_of(
    text: &str,
    function: &str,
    statements: &[LetStatement],
    indices: &[usize],
) -> Option<BTreeMap<usize, String>> {
    let (mut copy, mut from) = (String::new(), 0);
    for index in indices {
        let LetStatement { name, end: Some(end), .. } = &statements[*index] else { continue };
        copy += &text[from..*end];
        copy += &format!(" var karat_let_{index} = {};", &text[name.clone()]);
        from = *end;
    }
    copy += &text[from..];
    let probed = Probed::new(&Package::from_source("karat_let", copy), function).ok()?;
    let mut locals = probed.program.locals(function)?;
    let ty =
        |index: &usize| Some((*index, locals.variables.remove(&*format!("karat_let_{index}"))?));
    Some(indices.iter().filter_map(ty).collect())
}

/// A probe of a generated function, which has the same parameters as the author's function. The generated function
/// calls a copy of the author's function, and returns the value of the binding `one`.
fn copy_that_returns(probed: &Probed, one: &LetStatement, ty: &str) -> Option<Probed> {
    let (program, text) = (&probed.program, probed.program.text());
    let locals = program.locals(&probed.function().name)?;
    let count = locals.parameters.len();
    let parameters = locals.parameters.iter().enumerate();
    let parameters: Vec<String> =
        parameters.map(|(index, ty)| format!("karat_{index}: {ty}")).collect();
    let arguments: Vec<String> = (0..count).map(|index| format!("karat_{index}")).collect();
    let end = one.end?;
    let copy = format!(
        "{} karat_let = {};{}\nvar<private> karat_let: {ty};\n\
         fn karat_let_of({}) -> {ty} {{\n    karat_let = {ty}();\n    \
         let karat_result = {}({});\n    return karat_let;\n}}\n",
        &text[..end],
        &text[one.name.clone()],
        &text[end..],
        parameters.join(", "),
        locals.function,
        arguments.join(", "),
    );
    let copy = Probed::new(&Package::from_source("karat_let", copy), "karat_let_of").ok()?;
    let given = probed.function().parameters.iter().map(|(_, shape)| shape.clone());
    Some(copy.with_quads_of(&given.collect::<Vec<_>>()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "fn half(x: f32) -> f32 { let h = 0.5 * x; return h; }\n\
        fn f(a: f32, v: vec3f) -> f32 {\n    \
        let d = dot(v, v) + a; let copy = d;\n    \
        if a > 0.0 { let e = /* half; */ (half(d)); return e; }\n    \
        var sum = 0.0; let p = &sum; let read = *p;\n    \
        for (var i = 0u; i < 3u; i++) { let step = clamp(f32(i), 0.0, 9.0); *p += step; }\n    \
        let d_1 = bitcast<u32>(sum); { let d = vec2u(d_1).x; sum += f32(d); }\n    \
        return sum;\n}\n";

    // Lesson 84
    #[test]
    fn each_binding_is_returned_by_a_function_of_its_own() {
        let package = Package::from_source("lets", TEXT);
        let probed = Probed::new(&package, "f").expect("valid");
        let lets = lets(&probed);
        let shown: Vec<(&str, bool)> =
            lets.iter().map(|one| (one.name.as_str(), one.probed.is_some())).collect();
        let expected = ["d", "copy", "e", "p", "read", "step", "d_1", "d"];
        assert_eq!(shown, expected.map(|name| (name, name != "p")));
        assert_eq!(lets.iter().filter(|one| one.of_name == (1, 2)).count(), 1);
        let place = lets[2].span.as_ref().expect("the author's").to_string();
        assert!(place.ends_with(":4:22"), "{place}");
        let parameters = |one: &Let| one.probed.as_ref().map(|p| p.function().parameters.len());
        assert_eq!(parameters(&lets[2]), Some(2));
    }

    // Lesson 84
    #[test]
    fn a_shadowing_binding_is_the_inner_one() {
        let text = "fn f(x: f32) -> f32 { let q = x; if x > 0.0 { let q = i32(x); return f32(q); }\n\
                    return q; }";
        let package = Package::from_source("lets", text);
        let probed = Probed::new(&package, "f").expect("valid");
        let results: Vec<String> = lets(&probed)
            .iter()
            .map(|one| format!("{:?}", one.probed.as_ref().expect("a number").function().result))
            .collect();
        assert!(results[0].contains("F32") && results[1].contains("I32"), "{results:?}");
    }
}
