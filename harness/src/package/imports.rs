//! Resolves import statements and paths to declarations.
//!
//! Before Karat links a module, it follows every import of the module, and of all modules that the module imports
//! directly or through others. So Karat reports a wrong import at the import statement, even if nothing uses the
//! import. In contrast, `naga_oil` resolves an import only where a module uses the imported name.

use std::collections::BTreeSet;
use std::ops::Range;

use super::CONSTANTS;
use super::PackageError;
use super::brackets::syntax_error;
use super::conditions::feature_of;
use super::library::{Library, ModulePath};
use super::syntax::Module;
use crate::diagnostic::{Diagnostic, Mend, Span, nearest};

/// The deepest nesting of braces in an import statement. Authors never nest braces so deeply, and Karat's recursive
/// reader doesn't overflow the stack at this depth.
const MOST_BRACES: usize = 32;

#[derive(Clone, Debug)]
pub(super) struct Import {
    /// The components of the import's path: `package`, `math`, `PI`.
    words: Vec<String>,
    /// The name under which the module uses the import.
    pub(super) alias: String,
    token: usize,
}

impl Import {
    fn item(&self) -> &str {
        self.words.last().expect("an import has a name")
    }

    /// Checks if an import has an effect. By `naga_oil`'s rules, an import has no effect if the module doesn't use
    /// the imported name, or declares this name itself.
    fn counts_in(&self, module: &Module) -> bool {
        let mut used = module.references.iter().flatten();
        let is_declared = || module.declared(&self.alias).next().is_some();
        let mut is_used = || used.any(|one| one.words(module)[0] == self.alias);
        !module.composes || (!is_declared() && is_used())
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// A declaration of a module.
    Item(ModulePath, String),
    /// A module, or a folder of modules.
    Module(ModulePath),
}

/// Follows each import of `root`, and of the modules that `root` reaches.
pub(super) fn check(library: &Library, root: &ModulePath) -> Result<(), PackageError> {
    check_more(library, root, &mut BTreeSet::new())
}

/// Like [`check`], but skips the modules in `good`, whose imports are correct. Adds the checked modules to `good`.
pub(super) fn check_more(
    library: &Library,
    root: &ModulePath,
    good: &mut BTreeSet<ModulePath>,
) -> Result<(), PackageError> {
    let mut seen = good.clone();
    let mut queue = Vec::from_iter(seen.insert(root.clone()).then(|| root.clone()));
    while let Some(path) = queue.pop() {
        let module = library.module(&path)?;
        for import in imports(&module)?.into_iter().filter(|import| import.counts_in(&module)) {
            let led = match led(library, &path, &module, &import) {
                // The linker reports this error at a use of the name, because `naga_oil` checks only used names.
                Err(Problem::Item { condition: Some(_), .. }) => continue,
                led => led,
            };
            let (Target::Item(reached, _) | Target::Module(reached)) = led
                .map_err(|problem| failed(problem, module.span(import.token), library, &import))?;
            if library.has(&reached) && seen.insert(reached.clone()) {
                queue.push(reached);
            }
        }
    }
    *good = seen;
    Ok(())
}

pub(super) fn imports(module: &Module) -> Result<Vec<Import>, PackageError> {
    let mut found = Vec::new();
    for statement in &module.imports {
        let mut at = statement.start;
        while module.text(at) != "import" {
            at += 1;
        }
        let inner = at + 1..statement.end - 1;
        let end = list(module, inner.clone(), &[], 0, &mut found)?;
        if end != inner.end {
            return Err(malformed(module, end));
        }
    }
    for (index, import) in found.iter().enumerate() {
        let first = found[..index].iter().find(|first| first.alias == import.alias);
        if let Some(first) = first.filter(|first| first.words != import.words) {
            return Err(twice(module, import, module.span(first.token), "imported before"));
        }
        // With `naga_oil`, an import may name a module. The name of a module can't clash with a declaration's
        // name.
        if let Some(declared) = module.declared(&import.alias).next().filter(|_| !module.composes) {
            let place = module.span(module.declarations[declared].name_token);
            return Err(twice(module, import, place, "declared here"));
        }
    }
    Ok(found)
}

/// The error for a name that has two meanings because of an import.
fn twice(module: &Module, import: &Import, first: Span, how: &str) -> PackageError {
    let message = format!("the name `{}` has two meanings in this module", import.alias);
    let diagnostic = Diagnostic::new(message)
        .at(module.span(import.token), "imported here")
        .at(first, how)
        .note("import the name under another name: `import package::module::name as other;`");
    PackageError::Shader(Box::new(diagnostic))
}

fn malformed(module: &Module, token: usize) -> PackageError {
    let message =
        "this import is malformed: write `import package::module::{name, other as alias};`";
    syntax_error(&module.file, module.span(token).range, message)
}

fn list(
    module: &Module,
    tokens: Range<usize>,
    prefix: &[String],
    depth: usize,
    found: &mut Vec<Import>,
) -> Result<usize, PackageError> {
    let mut words = prefix.to_vec();
    let mut at = tokens.start;
    loop {
        if at >= tokens.end {
            return Err(malformed(module, at));
        }
        if module.is(at, b'{') {
            if depth == MOST_BRACES {
                return Err(malformed(module, at));
            }
            let close = module.brackets[at];
            let mut item = at + 1;
            while item < close {
                item = list(module, item..close, &words, depth + 1, found)?;
                if item < close {
                    if !module.is(item, b',') {
                        return Err(malformed(module, item));
                    }
                    item += 1;
                }
            }
            return Ok(close + 1);
        }
        if !module.is_word(at) {
            return Err(malformed(module, at));
        }
        words.push(module.text(at).to_owned());
        if at + 2 < tokens.end && module.is(at + 1, b':') && module.is(at + 2, b':') {
            at += 3;
            continue;
        }
        let token = at;
        let mut alias = module.text(at).to_owned();
        at += 1;
        if at < tokens.end && module.text(at) == "as" {
            if at + 1 >= tokens.end || !module.is_word(at + 1) {
                return Err(malformed(module, at));
            }
            alias = module.text(at + 1).to_owned();
            at += 2;
        }
        // `naga_oil` also imports whole modules.
        if words.len() < 2 && !module.composes {
            let message = "an import needs a package and a module: `import package::module::name;`";
            return Err(syntax_error(&module.file, module.span(token).range, message));
        }
        // `#import bevy_pbr::utils PI, E`, the first syntax of `naga_oil`.
        if module.composes && depth == 0 && at < tokens.end && module.is_word(at) {
            while at < tokens.end {
                at = list(module, at..tokens.end, &words, 1, found)?;
                if at < tokens.end {
                    if !module.is(at, b',') {
                        return Err(malformed(module, at));
                    }
                    at += 1;
                }
            }
            return Ok(at);
        }
        found.push(Import { words, alias, token });
        return Ok(at);
    }
}

enum Problem {
    Module(PackageError),
    Item { module: ModulePath, nearest: Option<String>, condition: Option<String> },
}

/// The declaration or module to which a module's import refers. If the imported module itself imports
/// the name from another module, the search continues in that module.
pub(super) fn follow(
    library: &Library,
    path: &ModulePath,
    module: &Module,
    import: &Import,
) -> Result<Target, PackageError> {
    let failed = |problem| failed(problem, module.span(import.token), library, import);
    led(library, path, module, import).map_err(failed)
}

fn led(
    library: &Library,
    path: &ModulePath,
    module: &Module,
    import: &Import,
) -> Result<Target, Problem> {
    // The modules on the way to the declaration, and the name in each of them.
    let mut chain: Vec<(ModulePath, String)> = vec![(path.clone(), import.alias.clone())];
    let mut target = locate(library, path, &import.words).map_err(Problem::Module)?;
    loop {
        let Target::Item(owner, name) = &target else { return Ok(target) };
        let step = (owner.clone(), name.clone());
        if chain.contains(&step) {
            let span = module.span(import.token);
            return Err(Problem::Module(cycle(library, &chain, &step, span)));
        }
        match declared_or_imported(library, owner, name)? {
            None => return Ok(target),
            Some(again) => {
                chain.push(step);
                target = again;
            }
        }
    }
}

/// The target of the import by which the module `path` knows `name`; `None` if the module declares `name` itself.
fn declared_or_imported(
    library: &Library,
    path: &ModulePath,
    name: &str,
) -> Result<Option<Target>, Problem> {
    let module = library.module(path).map_err(Problem::Module)?;
    if module.declared(name).next().is_some() {
        return Ok(None);
    }
    let own = imports(&module).map_err(Problem::Module)?;
    if let Some(again) = own.iter().find(|import| import.alias == name) {
        return locate(library, path, &again.words).map(Some).map_err(Problem::Module);
    }
    let inactive = module.inactive.iter().find(|inactive| inactive.name == name);
    Err(Problem::Item {
        nearest: nearest(name, module.names()).map(str::to_owned),
        condition: inactive.map(|inactive| inactive.condition.clone()),
        module: path.clone(),
    })
}

/// The module or the declaration to which a path in the module `from` refers.
fn locate(library: &Library, from: &ModulePath, words: &[String]) -> Result<Target, PackageError> {
    // The paths that modules declare for themselves don't begin with a package.
    if library.module(from)?.composes && !matches!(&*words[0], "package" | "super") {
        return match library.composed(from, words)? {
            Some((owner, count)) if count == words.len() => Ok(Target::Module(owner)),
            Some((owner, count)) if count + 1 == words.len() => {
                Ok(Target::Item(owner, words[count].clone()))
            }
            _ => Err(library.not_composed(&words[..words.len() - 1].join("::"))),
        };
    }
    let supers = words.iter().take_while(|word| *word == "super").count();
    let (package, mut components, rest) = match words[0].as_str() {
        "package" => (from.package, Vec::new(), &words[1..]),
        "super" => {
            let above = || PackageError::AboveRoot { package: library.name(from.package) };
            let kept = from.components.len().checked_sub(supers).ok_or_else(above)?;
            (from.package, from.components[..kept].to_vec(), &words[supers..])
        }
        name => match library.dependency(from.package, name) {
            Ok(package) => (package, Vec::new(), &words[1..]),
            // Engines use their own names for the modules of a crate.
            Err(_) if library.is_own(from.package, name) => (from.package, Vec::new(), words),
            Err(_) if library.name(from.package) == name => (from.package, Vec::new(), &words[1..]),
            Err(error) => return Err(error),
        },
    };
    components.extend(rest.iter().cloned());
    let inner = ModulePath { package, components };
    if library.has(&inner) {
        return Ok(Target::Module(inner));
    }
    let mut owner = inner.clone();
    let item = owner.components.pop();
    match item {
        Some(item) if library.has(&owner) => Ok(Target::Item(owner, item)),
        _ if library.has_below(&inner) => Ok(Target::Module(inner)),
        // Reading a missing module returns an error that names the module.
        _ => Err(match library.read(&owner) {
            Err(error) => error,
            Ok(_) => unreachable!("`has` and `read` look in the same places"),
        }),
    }
}

/// The declaration to which a path in code refers, such as `math::PI`.
pub(super) fn resolve_path(
    library: &Library,
    path: &ModulePath,
    module: &Module,
    imports: &[Import],
    words: &[&str],
    tokens: &Range<usize>,
) -> Result<Target, PackageError> {
    let last = tokens.end - 1;
    let as_import = |words: Vec<String>| Import {
        alias: words.last().cloned().unwrap_or_default(),
        words,
        token: last,
    };
    let mut full: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
    // The first word may be the name of an imported module.
    if let Some(import) = imports.iter().find(|import| import.alias == words[0]) {
        full.splice(0..1, import.words.iter().cloned());
    }
    let import = as_import(full);
    let unresolved = |error: PackageError| {
        let diagnostic = Diagnostic::new(format!("unresolved path `{}`", words.join("::")))
            .at(module.span(last), "")
            .note(error.to_string());
        PackageError::Shader(Box::new(diagnostic))
    };
    match locate(library, path, &import.words) {
        Err(error @ (PackageError::Shader(_) | PackageError::NotUtf8 { .. })) => Err(error),
        Err(error) => Err(unresolved(error)),
        Ok(Target::Module(found)) => {
            let message = format!("`{}` is a module, not a declaration", library.shown(&found));
            let diagnostic = Diagnostic::new(message).at(module.span(last), "");
            Err(PackageError::Shader(Box::new(diagnostic)))
        }
        Ok(Target::Item(owner, name)) => match declared_or_imported(library, &owner, &name) {
            Ok(None) => Ok(Target::Item(owner, name)),
            Ok(Some(_)) => follow(library, path, module, &import),
            Err(Problem::Module(error)) => Err(error),
            Err(Problem::Item { module: owner, nearest, condition }) => {
                let owner = library.shown(&owner);
                let message = format!("module `{owner}` has no declaration `{name}`");
                let diagnostic = Diagnostic::new(message).at(module.span(last), "");
                Err(hinted(diagnostic, (&owner, &name), nearest, condition))
            }
        },
    }
}

fn failed(problem: Problem, span: Span, library: &Library, import: &Import) -> PackageError {
    let item = import.item();
    match problem {
        Problem::Module(error @ (PackageError::Shader(_) | PackageError::NotUtf8 { .. })) => error,
        Problem::Module(error) => {
            let message = format!("unresolved import of `{}`", import.words.join("::"));
            let mend = match &error {
                PackageError::UnknownPackage { name, .. } => Some(Mend::Dependency(name.clone())),
                PackageError::NotComposed { .. } => Some(Mend::Dependency(import.words[0].clone())),
                _ => None,
            };
            let diagnostic = Diagnostic::new(message)
                .at(span, "imported here")
                .note(error.to_string())
                .mended_by(mend);
            PackageError::Shader(Box::new(diagnostic))
        }
        Problem::Item { module, nearest, condition } => {
            let module = library.shown(&module);
            let message = format!("unresolved import: module `{module}` declares no `{item}`");
            let diagnostic = Diagnostic::new(message).at(span, "imported here");
            hinted(diagnostic, (&module, item), nearest, condition)
        }
    }
}

/// Adds to an error the probable reason why a name is missing: a false condition, or a typo.
fn hinted(
    diagnostic: Diagnostic,
    (module, name): (&str, &str),
    nearest: Option<String>,
    condition: Option<String>,
) -> PackageError {
    let mend = match &condition {
        None if module == CONSTANTS => Some(Mend::Feature(name.to_owned())),
        None => None,
        Some(condition) => feature_of(condition).map(Mend::Condition),
    };
    let diagnostic = diagnostic.mended_by(mend);
    let diagnostic = match (condition, nearest) {
        (None, _) if module == CONSTANTS => diagnostic.note(format!(
            "to set the feature `{name}`, write `.feature(\"{name}\", 3)` in Rust, or `--feature {name}=3`"
        )),
        (Some(condition), _) => diagnostic
            .note(format!("`{name}` is declared under `{condition}`, which is false here")),
        (None, Some(name)) => diagnostic.note(format!("did you mean `{name}`?")),
        (None, None) => diagnostic,
    };
    PackageError::Shader(Box::new(diagnostic))
}

fn cycle(
    library: &Library,
    chain: &[(ModulePath, String)],
    last: &(ModulePath, String),
    span: Span,
) -> PackageError {
    let shown =
        |(module, item): &(ModulePath, String)| format!("{}::{item}", library.shown(module));
    let route: Vec<_> = chain.iter().chain([last]).map(shown).collect();
    let message = format!("import cycle: `{}` is imported, but never declared", chain[0].1);
    let diagnostic = Diagnostic::new(message).at(span, "imported here").note(route.join(" -> "));
    PackageError::Shader(Box::new(diagnostic))
}
