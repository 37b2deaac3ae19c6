//! The call graph of a package.

use std::collections::{BTreeMap, BTreeSet};

use karat::package::Package;
use karat::unstable::reflect::Program;

/// The call graph: each function with its direct callers.
#[derive(Debug, Default)]
pub(super) struct Callers {
    by_called: BTreeMap<String, BTreeSet<String>>,
}

impl Callers {
    /// Builds the call graph from the modules that can be read.
    pub(super) fn of(package: &Package) -> Self {
        let mut callers = Self::default();
        for module in package.modules().unwrap_or_default() {
            let Ok(items) = package.functions_in(&module) else { continue };
            let whole = Program::of_module(package, &module).ok();
            for item in items {
                // An invalid module may contain valid functions.
                let own = item.name.rsplit("::").next().unwrap_or_default();
                let alone = || Program::of_items(package, &module, &[own]).ok();
                let Some(program) = whole.clone().or_else(alone) else { continue };
                for called in program.calls(&item.name) {
                    callers.by_called.entry(called).or_default().insert(item.name.clone());
                }
            }
        }
        callers
    }

    pub(super) fn calls(&self, function: &str) -> bool {
        self.by_called.contains_key(function)
    }

    /// Returns the functions whose runs decide the class of a function's findings: the outermost checked caller in each
    /// chain of callers. If there is no checked caller, returns the function itself.
    pub(super) fn roots<'c>(
        &'c self,
        function: &'c str,
        looked_at: &BTreeSet<&str>,
    ) -> BTreeSet<&'c str> {
        let (mut roots, mut seen) = (BTreeSet::new(), BTreeSet::from([function]));
        let mut open = vec![(function, function)];
        // Each direct or indirect caller, with the last checked function in the chain of callers up to it.
        while let Some((one, last)) = open.pop() {
            let Some(all) = self.by_called.get(one) else {
                roots.insert(last);
                continue;
            };
            for caller in all.iter().map(String::as_str).filter(|one| seen.insert(one)) {
                open.push((caller, if looked_at.contains(caller) { caller } else { last }));
            }
        }
        if roots.len() > 1 {
            // One chain of callers contains a checked function, and another chain contains none.
            roots.remove(function);
        }
        roots
    }
}
