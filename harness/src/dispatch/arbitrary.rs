//! Compute passes over resources that are made up.

use super::{Passes, Wanted};
use crate::made_up::{Extents, Ranges, Resources};
use crate::package::Package;
use crate::reflect::{Overrides, Program};

/// Contents that are tried: as many elements as are dispatched, in order; fewer, so that the last workgroup has a
/// tail; then draws.
pub(crate) const VARIANTS: usize = 4;

/// Invocations of a pass, at least.
const INVOCATIONS: u32 = 64;

/// Workgroups over which a pass is dispatched if nothing says it: two in each direction in which a workgroup extends,
/// as nothing orders two of them.
pub(crate) fn usual_workgroups(size: [u32; 3]) -> [u32; 3] {
    let mut groups = size.map(|count| if count > 1 { 2 } else { 1 });
    groups[0] = groups[0].max(2);
    while size.iter().chain(&groups).product::<u32>() < INVOCATIONS {
        groups[0] *= 2;
    }
    groups
}

impl Passes {
    /// One pass over made-up resources, whose sizes follow from what is dispatched.
    ///
    /// # Errors
    /// If the pass isn't valid, or a resource can't be made up, in one line.
    pub(crate) fn arbitrary(
        package: &Package,
        name: &str,
        workgroups: Option<[u32; 3]>,
        ranges: &Ranges,
        variant: usize,
    ) -> Result<(Self, Resources), String> {
        let (module, own) = name.rsplit_once("::").unwrap_or(("", name));
        let program =
            Program::of_items(package, module, &[own]).map_err(|error| error.to_string())?;
        let program = program.overridden(&Overrides::new()).map_err(|error| error.to_string())?;
        let entry_point = program.compute_entry_point(program.entry_point_name(own));
        let (bindings, size) =
            entry_point.ok_or_else(|| format!("`{name}` is no compute entry point"))?;
        let workgroups = workgroups.unwrap_or_else(|| usual_workgroups(size));
        let extents = Extents::of(size, workgroups, variant);
        let made = Resources::of_pass((&program, &bindings), ranges, extents, variant)?;
        let wanted = Wanted { name: name.to_owned(), workgroups };
        let passes = Self::new(package, &[wanted], (&made.fixtures, &[]), &Overrides::new());
        Ok((passes.map_err(|error| error.to_string())?, made))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_workgroups_run_in_each_direction_that_a_workgroup_has() {
        assert_eq!(usual_workgroups([256, 1, 1]), [2, 1, 1]);
        assert_eq!(usual_workgroups([8, 8, 1]), [2, 2, 1]);
        assert_eq!(usual_workgroups([1, 1, 1]), [64, 1, 1]);
        assert_eq!(usual_workgroups([1, 16, 1]), [2, 2, 1]);
    }
}
