//! From modules with imports to one WGSL text with a source map.

use std::collections::BTreeMap;
use std::sync::Arc;

use wesl::{CompileOptions, EscapeMangler, Feature, Mangler, ModulePath};
use wgsl_parse::SyntaxNode;
use wgsl_parse::syntax::{GlobalDeclaration, PathOrigin};

use super::library::Library;
use super::source_map::SourceMap;
use super::{Package, PackageError, imports, syntax_error};
use crate::diagnostic::{Diagnostic, SourceFile, Span, nearest};

/// WGSL without imports, and the way back to the author's files.
#[derive(Clone, Debug)]
pub(crate) struct Linked {
    /// Plain WGSL.
    pub(crate) text: String,
    /// From `text` to the author's files.
    pub(crate) map: SourceMap,
    /// Author's path of each declaration, `fresnel::schlick`, by its name in `text`.
    pub(crate) names: BTreeMap<String, String>,
    /// The file that holds the linked item.
    pub(crate) file: Arc<SourceFile>,
}

impl Package {
    /// Links the closure of one declaration: what it needs from any module, and nothing else.
    pub(crate) fn link(&self, path: &str) -> Result<Linked, PackageError> {
        let (module, item) = path.rsplit_once("::").unwrap_or(("", path));
        let linked = self.link_items(module, &[item])?;
        if linked.names.contains_key(item) {
            return Ok(linked);
        }
        Err(self.unknown_function(path))
    }

    /// Links the closure of several declarations of one module.
    pub(crate) fn link_items(&self, module: &str, items: &[&str]) -> Result<Linked, PackageError> {
        let components: Vec<String> =
            module.split("::").filter(|part| !part.is_empty()).map(str::to_owned).collect();
        let root = ModulePath::new(PathOrigin::Absolute, components);
        let library = Library::open(self)?;
        let file = library.read(&root).map_err(|error| match error {
            PackageError::UnknownModule { .. } if items.len() == 1 => {
                let path = if module.is_empty() {
                    items[0].to_owned()
                } else {
                    format!("{module}::{}", items[0])
                };
                self.unknown_function(&path)
            }
            other => other,
        })?;
        imports::check(&library, &root)?;

        let mut options = CompileOptions {
            validate: false, // naga validates the linked text, with spans
            keep: Some(items.iter().map(|item| (*item).to_owned()).collect()),
            ..CompileOptions::default()
        };
        for (name, enabled) in &self.features {
            let feature = if *enabled { Feature::Enable } else { Feature::Disable };
            options.features.flags.insert(name.to_string(), feature);
        }
        let compiled = wesl::compile_sourcemap(&root, &library, &EscapeMangler, &options)
            .map_err(|error| wesl_error(error, &library, &root))?;

        let mut text = String::new();
        for directive in &compiled.syntax.global_directives {
            text.push_str(&format!("{directive}\n"));
        }
        let mut linked = Linked { text, map: SourceMap::default(), names: BTreeMap::new(), file };
        let mangled: BTreeMap<String, (ModulePath, String)> = compiled
            .syntax
            .global_declarations
            .iter()
            .filter_map(|declaration| {
                let name = declaration.ident()?.name().clone();
                let origin = EscapeMangler.unmangle(&name).filter(|(path, _)| library.has(path));
                Some((name.clone(), origin.unwrap_or((root.clone(), name))))
            })
            .collect();
        let unmangle = |name: &str| mangled.get(name).map(|(_, item)| item.clone());
        for declaration in &compiled.syntax.global_declarations {
            if matches!(declaration.node(), GlobalDeclaration::Void) {
                continue;
            }
            let start = linked.text.len();
            let printed = format!("{}\n\n", declaration.node());
            linked.text.push_str(&printed);
            let name = declaration.ident().map(|ident| ident.name().clone());
            let origin = name.as_ref().and_then(|name| mangled.get(name));
            let module = origin.map_or(&root, |(module, _)| module);
            let file = library.read(module)?;
            let range = declaration.span().range();
            linked.map.align(&printed, start, &file, range, &unmangle);
            if let (Some(name), Some((module, item))) = (name, origin) {
                linked.names.insert(name, author_path(module, item));
            }
        }
        Ok(linked)
    }

    fn unknown_function(&self, path: &str) -> PackageError {
        let known: Vec<String> = match self.functions() {
            Ok(functions) => functions.into_iter().map(|function| function.path).collect(),
            Err(error) => return error,
        };
        PackageError::UnknownFunction {
            path: path.to_owned(),
            package: self.name().to_owned(),
            nearest: nearest(path, known.iter().map(String::as_str)).map(str::to_owned),
            count: known.len(),
        }
    }
}

/// `fresnel::schlick` for an item of this package, `noise::value::perlin` for a dependency's.
fn author_path(module: &ModulePath, item: &str) -> String {
    let package = match &module.origin {
        PathOrigin::Package(name) => Some(name.clone()),
        _ => None,
    };
    package
        .into_iter()
        .chain(module.components.iter().cloned())
        .chain([item.to_owned()])
        .collect::<Vec<_>>()
        .join("::")
}

/// The linker's own errors, at the author's place where they have one.
fn wesl_error(error: wesl::Error, library: &Library<'_>, root: &ModulePath) -> PackageError {
    let error = wesl::Diagnostic::from(error);
    let module = error.detail.module_path.clone().unwrap_or_else(|| root.clone());
    let file = match library.read(&module) {
        Ok(file) => file,
        Err(error) => return error,
    };
    if let wesl::Error::ParseError(parse) = &*error.error {
        return syntax_error(parse, &file);
    }
    let message = error.error.to_string();
    // The last word between backquotes is the name that the linker could not resolve. It doesn't
    // say where, but that is where the name stands.
    let name = message.rsplit('`').nth(1).and_then(|name| name.rsplit("::").next());
    let span = match (&error.detail.span, name) {
        (Some(span), _) => Some(Span { file: Arc::clone(&file), range: span.range() }),
        (None, Some(name)) => library.find_name(name),
        (None, None) => None,
    };
    let span = span.unwrap_or(Span { file, range: 0..0 });
    PackageError::Shader(Box::new(Diagnostic::new(message).at(span, "")))
}
