//! The functions of a package that call each other.

use std::collections::{BTreeMap, BTreeSet};

use karat::package::Package;
use karat::unstable::reflect::Program;

/// Functions by those that they call.
#[derive(Debug, Default)]
pub(super) struct Callers {
    by_called: BTreeMap<String, BTreeSet<String>>,
}

impl Callers {
    /// The calls of a package, as far as its modules can be read.
    pub(super) fn of(package: &Package) -> Self {
        let mut callers = Self::default();
        for module in package.modules().unwrap_or_default() {
            let Ok(items) = package.functions_in(&module) else { continue };
            let whole = Program::of_module(package, &module).ok();
            for item in items {
                // Of a module that isn't valid some functions are.
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

    /// Returns `true` for a function that some other one calls.
    pub(super) fn calls(&self, function: &str) -> bool {
        self.by_called.contains_key(function)
    }

    /// The functions that lead to this one, of those that are `looked_at`, and that none of these calls: the function itself
    /// if none leads to it.
    pub(super) fn roots<'c>(
        &'c self,
        function: &'c str,
        looked_at: &BTreeSet<&str>,
    ) -> BTreeSet<&'c str> {
        let (mut roots, mut seen) = (BTreeSet::new(), BTreeSet::from([function]));
        let mut open = vec![(function, function)];
        // Beside each function the last one on the way that was looked at.
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
            // Some way has a function that was looked at, and another way none.
            roots.remove(function);
        }
        roots
    }
}
