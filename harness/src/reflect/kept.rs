//! Caches the programs of a process, so that several checks link, parse and validate a function once.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::message::with_declarers;
use super::{Program, ReflectError};
use crate::package::workspace::{self, Kind};
use crate::package::{Discards, Package};

/// The cached programs. The key is the function, the module or the declarations for which Karat linked a program. If
/// several packages have a function or module of the same name, the key has a program for each package.
struct Programs;

impl Kind for Programs {
    type Key = Wanted;
    type Value = Vec<(Package, Arc<Program>)>;
    // Any project has fewer functions and tests than this.
    const MOST: usize = 4096;
}

/// The largest number of packages whose programs are cached for one key. The limit is necessary because tests may open
/// many texts in memory whose functions have the same name.
const MOST_PACKAGES: usize = 8;

#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) enum Wanted {
    Function(String),
    Module(String),
    Items(String, Vec<String>),
}

/// Returns the cached program if its files are unchanged. Otherwise links a new program. This function reads the files
/// at each call, so it notices each change of a text. If a new file would change the program, only the next process
/// notices this file.
pub(super) fn again(package: &Package, wanted: &Wanted) -> Result<Arc<Program>, ReflectError> {
    let of_package = |kept: &(Package, Arc<Program>)| kept.0 == *package;
    let known = workspace::with::<Programs, _>(|kept| {
        let kept = kept.get(wanted)?.iter().find(|kept| of_package(kept))?;
        Some(Arc::clone(&kept.1))
    });
    if let Some(program) = known
        && program.linked.sources.are_current()?
    {
        return Ok(program);
    }
    let linked = match wanted {
        Wanted::Function(path) => package.link(path, Discards::Assigned)?,
        Wanted::Module(module) => package.link_module(module)?,
        Wanted::Items(module, items) => {
            let items: Vec<&str> = items.iter().map(String::as_str).collect();
            package.link_items(module, &items)?
        }
    };
    let program = Program::from_linked(linked);
    let mut program = program.map_err(|error| with_declarers(package, error))?;
    if let Wanted::Function(path) = wanted {
        if program.discards_and_writes(path) {
            program = Program::from_linked(package.link(path, Discards::Kept)?)?;
        }
        if let Some(linked) = program.with_variables(path) {
            program = Program::from_linked(linked)?;
        }
    }
    let program = Arc::new(program);
    workspace::with_room::<Programs, _>(|kept| {
        let kept = kept.entry(wanted.clone()).or_default();
        kept.retain(|kept| !of_package(kept));
        if kept.len() >= MOST_PACKAGES {
            kept.remove(0); // the oldest
        }
        kept.push((package.clone(), Arc::clone(&program)));
    });
    Ok(program)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bound(package: &Package) -> usize {
        Program::of_function(package, "a::f").expect("valid").module().functions.len()
    }

    /// The cache returns the same program as long as its files are unchanged. Karat links the program again if an
    /// imported module changes, a feature changes, or a file disappears.
    // Lesson 80
    #[test]
    fn a_program_is_made_again_when_a_text_changes() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let write = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).expect("written");
        };
        write("a.wgsl", "import package::b::g;\nfn f(x: f32) -> f32 { return g(x); }\n");
        write(
            "b.wgsl",
            "@if(twice) fn h(x: f32) -> f32 { return x + x; }\n\
                         @if(twice) fn g(x: f32) -> f32 { return h(x); }\n\
                         @if(!twice) fn g(x: f32) -> f32 { return x; }\n",
        );
        let package = Package::open(folder.path()).expect("a package");
        let first = Program::of_function(&package, "a::f").expect("valid");
        let again = Program::of_function(&package, "a::f").expect("valid");
        assert!(Arc::ptr_eq(&first, &again));
        assert_eq!((bound(&package), bound(&package.clone().feature("twice", true))), (2, 3));
        write(
            "b.wgsl",
            "fn h(x: f32) -> f32 { return x; }\nfn g(x: f32) -> f32 { return h(x); }\n",
        );
        assert_eq!(bound(&package), 3);
        std::fs::remove_file(folder.path().join("b.wgsl")).expect("removed");
        assert!(Program::of_function(&package, "a::f").is_err());
        let text = |value: &str| format!("fn f() -> f32 {{ return {value}; }}");
        let other = |value: &str| Package::from_modules("m", [("a", text(value))]);
        for value in ["1.0", "2.0"] {
            let program = Program::of_function(&other(value), "a::f").expect("valid");
            assert!(program.text().contains(value));
        }
    }
}
