//! Checks the imports of a module and of all that it reaches, before linking.
//!
//! The linker reports a failed import without its place, and follows re-exports without looking
//! for cycles. Here every import is followed to its declaration, and what is wrong is shown at
//! the import statement.

use std::collections::BTreeSet;
use std::sync::Arc;

use wesl::ModulePath;
use wgsl_parse::SyntaxNode;
use wgsl_parse::lexer::{Lexer, Token};
use wgsl_parse::syntax::{ImportContent, PathOrigin, TranslationUnit};

use super::library::Library;
use super::{PackageError, syntax_error};
use crate::diagnostic::{Diagnostic, SourceFile, Span, nearest};

/// An imported name: `item` of the module at `path`, known as `alias`.
struct Import {
    path: ModulePath,
    item: String,
    alias: String,
}

/// Follows each import of `root`, and of the modules that it reaches.
pub(super) fn check(library: &Library<'_>, root: &ModulePath) -> Result<(), PackageError> {
    let mut seen = BTreeSet::from([root.to_string()]);
    let mut queue = vec![root.clone()];
    while let Some(path) = queue.pop() {
        let (file, unit) = parse(library, &path)?;
        for import in imports(&unit, &path) {
            let mut chain = vec![(path.clone(), import.alias.clone())];
            let module = follow(library, &import, &mut chain).map_err(|problem| {
                let span = import_span(&file, &import.item);
                problem.at(span, &path, &import, &chain)
            })?;
            if seen.insert(module.to_string()) {
                queue.push(module);
            }
        }
    }
    Ok(())
}

enum Problem {
    Module(PackageError),
    Item { module: ModulePath, nearest: Option<String> },
    Cycle,
}

impl Problem {
    fn at(
        self,
        span: Span,
        path: &ModulePath,
        import: &Import,
        chain: &[(ModulePath, String)],
    ) -> PackageError {
        let item = &import.item;
        let diagnostic = match self {
            Self::Module(error @ (PackageError::Shader(_) | PackageError::NotUtf8 { .. })) => {
                return error;
            }
            Self::Module(error) => {
                Diagnostic::new(format!("unresolved import of `{}::{item}`", import.path))
                    .at(span, "imported here")
                    .note(error.to_string())
            }
            Self::Item { module, nearest } => {
                let diagnostic = Diagnostic::new(format!(
                    "unresolved import: module `{module}` declares no `{item}`"
                ))
                .at(span, "imported here");
                match nearest {
                    Some(name) => diagnostic.note(format!("did you mean `{name}`?")),
                    None => diagnostic,
                }
            }
            Self::Cycle => {
                let route: Vec<_> =
                    chain.iter().map(|(module, item)| format!("{module}::{item}")).collect();
                Diagnostic::new(format!("import cycle: `{item}` is imported, but never declared"))
                    .at(span, "imported here")
                    .note(format!("{} -> {path}::{}", route.join(" -> "), import.alias))
            }
        };
        PackageError::Shader(Box::new(diagnostic))
    }
}

/// The module that declares what is imported; `chain` is the route of re-exports to it.
fn follow(
    library: &Library<'_>,
    import: &Import,
    chain: &mut Vec<(ModulePath, String)>,
) -> Result<ModulePath, Problem> {
    // `import package::math;` names a module and is used as `math::PI`.
    let inner = import.path.clone().join([import.item.clone()]);
    if library.has(&inner) {
        return Ok(inner);
    }
    let step = (import.path.clone(), import.item.clone());
    if chain.contains(&step) {
        return Err(Problem::Cycle);
    }
    let (_, unit) = parse(library, &import.path).map_err(Problem::Module)?;
    let declared: Vec<String> = unit
        .global_declarations
        .iter()
        .filter_map(|declaration| declaration.ident().map(|ident| ident.name().clone()))
        .collect();
    if declared.contains(&import.item) {
        return Ok(import.path.clone());
    }
    let again = imports(&unit, &import.path).into_iter().find(|next| next.alias == import.item);
    match again {
        Some(next) => {
            chain.push(step);
            follow(library, &next, chain)
        }
        None => Err(Problem::Item {
            nearest: nearest(&import.item, declared.iter().map(String::as_str)).map(str::to_owned),
            module: import.path.clone(),
        }),
    }
}

fn parse(
    library: &Library<'_>,
    path: &ModulePath,
) -> Result<(Arc<SourceFile>, TranslationUnit), PackageError> {
    let file = library.read(path)?;
    let unit = wgsl_parse::parse_str(&file.text).map_err(|error| syntax_error(&error, &file))?;
    Ok((file, unit))
}

fn imports(unit: &TranslationUnit, path: &ModulePath) -> Vec<Import> {
    fn flatten(content: &ImportContent, path: &ModulePath, found: &mut Vec<Import>) {
        match content {
            ImportContent::Item(item) => {
                let name = item.ident.name().clone();
                let alias = item.rename.as_ref().map_or(name.clone(), |ident| ident.name().clone());
                found.push(Import { path: path.clone(), item: name, alias });
            }
            ImportContent::Collection(imports) => {
                for import in imports {
                    let path = path.clone().join(import.path.iter().cloned());
                    flatten(&import.content, &path, found);
                }
            }
        }
    }

    let mut found = Vec::new();
    for statement in &unit.imports {
        match (&statement.path, &statement.content) {
            (Some(prefix), content) => flatten(content, &path.join_path(prefix), &mut found),
            // `import {noise::value, ...};`: the first name is a package.
            (None, ImportContent::Collection(imports)) => {
                for import in imports {
                    if let Some((package, rest)) = import.path.split_first() {
                        let origin = PathOrigin::Package(package.clone());
                        let prefix = path.join_path(&ModulePath::new(origin, rest.to_vec()));
                        flatten(&import.content, &prefix, &mut found);
                    }
                }
            }
            (None, ImportContent::Item(_)) => {}
        }
    }
    found
}

/// Where an import statement names `item`. The syntax tree keeps no place for imports.
fn import_span(file: &Arc<SourceFile>, item: &str) -> Span {
    let mut inside = false;
    let place = Lexer::new(&file.text).map_while(Result::ok).find(|(start, token, end)| {
        match token {
            Token::KwImport => inside = true,
            Token::SymSemicolon => inside = false,
            _ => {}
        }
        inside && &file.text[*start..*end] == item
    });
    let range = place.map_or(0..0, |(start, _, end)| start..end);
    Span { file: Arc::clone(file), range }
}
