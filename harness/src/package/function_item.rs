//! A function of a package.

use super::stage::Stage;
use super::syntax::{DeclarationKind, Module};
use crate::diagnostic::Span;

/// A function of a package.
///
/// ```
/// use karat::Package;
///
/// let function = &Package::from_source("m", "\nfn f() {}").functions()?[0];
/// assert_eq!(function.span.file.line_column(function.span.range.start), (2, 4));
/// # Ok::<(), karat::package::PackageError>(())
/// ```
#[derive(Clone, Debug)]
pub struct FunctionItem {
    /// The function's path: `module::name`, or `name` in a package of one module.
    pub name: String,
    /// The location of the function's name.
    pub span: Span,
    /// The whole function, with its attributes.
    pub whole: Span,
    /// The stage, if the function is an entry point.
    pub entry_point: Option<Stage>,
}

/// The functions of the module `name`, without its tests.
pub(super) fn functions_of(name: &str, module: &Module) -> Vec<FunctionItem> {
    let functions = module.declarations.iter().filter_map(|declaration| {
        let item = declaration.name.as_ref()?;
        let name = if name.is_empty() { item.clone() } else { format!("{name}::{item}") };
        let (span, entry_point) = (module.span(declaration.name_token), declaration.entry_point);
        let first = module.span(declaration.tokens.start);
        let last = module.span(declaration.tokens.end.saturating_sub(1));
        let whole = Span { range: first.range.start..last.range.end, ..first };
        let function = declaration.kind == DeclarationKind::Function && !declaration.test;
        function.then_some(FunctionItem { name, span, whole, entry_point })
    });
    functions.collect()
}
