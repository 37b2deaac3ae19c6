//! Finds files that share a namespace.

use std::sync::Arc;

use super::{Library, ModulePath};
use crate::diagnostic::{Diagnostic, Span, nearest};
use crate::package::PackageError;
use crate::package::directives::{self, Include};
use crate::package::feature::Feature;

impl Library {
    /// The modules that share a namespace with `root`: the modules that `root` includes, directly or through others.
    pub(in crate::package) fn included(
        &self,
        root: &ModulePath,
    ) -> Result<Vec<ModulePath>, PackageError> {
        let (mut found, mut queue) = (Vec::new(), vec![root.clone()]);
        while let Some(path) = queue.pop() {
            let module = self.module(&path)?;
            for (include, range) in &module.includes {
                // `naga_oil` imports a whole module in this way. The module's name stays in front of the imported
                // names.
                if let Include::Name(name) = include
                    && self.composed(&path, std::slice::from_ref(name))?.is_some()
                {
                    continue;
                }
                let span = Span { file: Arc::clone(&module.file), range: range.clone() };
                let Some(included) = self.include(&path, include, &span)? else {
                    let name = include.name();
                    let known = self.package(path.package).modules().unwrap_or_default();
                    let last = known.iter().filter_map(|module| module.rsplit("::").next());
                    let diagnostic =
                        Diagnostic::new(format!("there is no module `{name}` to include"));
                    let diagnostic = diagnostic.at(span, "");
                    let outside = match include {
                        Include::File(file) => file.split('/').filter(|part| *part == "..").count(),
                        Include::Name(_) | Include::Joined(_) => 0,
                    };
                    let diagnostic = if outside >= path.components.len() && outside > 0 {
                        let package = self.name(path.package);
                        diagnostic
                            .note(format!("the path of this file leads out of package `{package}`"))
                    } else {
                        diagnostic
                    };
                    let diagnostic = match nearest(name, last).filter(|near| *near != name) {
                        Some(near) => diagnostic.note(format!("did you mean `{near}`?")),
                        None => diagnostic,
                    };
                    return Err(PackageError::Shader(Box::new(diagnostic)));
                };
                let text = &self.module(&included)?.file.text;
                // A guard applies to its own file. Other files may compare the name with a value.
                let guards = directives::guards(text);
                let is_asked = guards.values().any(|value| matches!(value, Feature::Number(_)));
                let defines = is_asked || !directives::defined(text).is_empty();
                if included != *root && defines {
                    let message = "this file has a `#define`, but a file that other files include can't define \
                                   names: move the `#define` to the including module";
                    let diagnostic = Diagnostic::new(message.to_owned()).at(span, "included here");
                    return Err(PackageError::Shader(Box::new(diagnostic)));
                }
                if included != *root && !found.contains(&included) {
                    found.push(included.clone());
                    queue.push(included);
                }
            }
        }
        Ok(found)
    }

    fn include(
        &self,
        from: &ModulePath,
        include: &Include,
        span: &Span,
    ) -> Result<Option<ModulePath>, PackageError> {
        let package = from.package;
        Ok(match include {
            Include::File(file) => {
                let folder = &from.components[..from.components.len().saturating_sub(1)];
                // The path is relative to the file, or else to the root.
                [folder, &[]].into_iter().find_map(|folder| {
                    let mut components = folder.to_vec();
                    for part in directives::without_extension(file).split('/') {
                        match part {
                            "" | "." => {}
                            ".." => drop(components.pop()?),
                            _ => components.push(part.to_owned()),
                        }
                    }
                    let path = ModulePath { package, components };
                    self.has(&path).then_some(path)
                })
            }
            Include::Joined(name) => {
                let components = name.split("::").map(str::to_owned).collect();
                let path = ModulePath { package, components };
                self.has(&path).then_some(path)
            }
            Include::Name(name) => {
                let known = self.package(package).modules().unwrap_or_default();
                let is_it = |module: &&String| module.rsplit("::").next() == Some(name);
                let found: Vec<&String> = known.iter().filter(is_it).collect();
                if let [first, second, ..] = *found {
                    let message = format!("two modules match `{name}`: `{first}` and `{second}`");
                    let diagnostic = Diagnostic::new(message).at(span.clone(), "included here");
                    return Err(PackageError::Shader(Box::new(diagnostic)));
                }
                found.first().map(|module| ModulePath {
                    package,
                    components: module.split("::").map(str::to_owned).collect(),
                })
            }
        })
    }
}
