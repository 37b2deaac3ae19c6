//! Compute passes over resources that are made up.

use super::{Passes, Wanted};
use crate::made_up::{Extents, Ranges, Resources};
use crate::package::Package;
use crate::reflect::{Overrides, Program};

/// Invocations of a pass, at least.
const INVOCATIONS: u32 = 64;

/// Workgroups over which a pass is dispatched if nothing says it: two in each direction in which a workgroup extends,
/// as nothing orders two of them, and three downwards, so that rows are no columns.
pub(crate) fn usual_workgroups(size: [u32; 3]) -> [u32; 3] {
    let mut groups = size.map(|count| if count > 1 { 2 } else { 1 });
    groups[0] = groups[0].max(2);
    if size[1] > 1 {
        groups[1] = 3;
    }
    while size.iter().chain(&groups).product::<u32>() < INVOCATIONS {
        groups[0] *= 2;
    }
    groups
}

/// Invocations in each direction over which both of two passes are dispatched, whatever their workgroups are: the size
/// of the first and of the second.
pub(crate) fn common_invocations(sizes: [[u32; 3]; 2]) -> [u32; 3] {
    [0, 1, 2].map(|k| {
        let usual = |size: [u32; 3]| size[k] * usual_workgroups(size)[k];
        let (one, other) = (sizes[0][k], sizes[1][k]);
        let both = (1..=other).map(|times| one * times).find(|all| all % other == 0);
        let both = both.unwrap_or(one * other);
        usual(sizes[0]).max(usual(sizes[1])).next_multiple_of(both)
    })
}

impl Passes {
    /// The invocations of a compute entry point's workgroup.
    ///
    /// # Errors
    /// If the entry point isn't valid, or is none of compute passes.
    pub(crate) fn workgroup_size(package: &Package, name: &str) -> Result<[u32; 3], String> {
        let (_, _, size) = Program::of_pass(package, name)?;
        Ok(size)
    }

    /// One pass over made-up resources, whose sizes follow from what is dispatched: so many invocations in each
    /// direction, if that is said.
    ///
    /// # Errors
    /// If the pass isn't valid, or a resource can't be made up.
    pub(crate) fn arbitrary(
        package: &Package,
        name: &str,
        invocations: Option<[u32; 3]>,
        ranges: &Ranges,
        variant: usize,
    ) -> Result<(Self, Resources), String> {
        let (program, bindings, size) = Program::of_pass(package, name)?;
        let workgroups = match invocations {
            Some(all) => [0, 1, 2].map(|k| all[k].div_ceil(size[k])),
            None => usual_workgroups(size),
        };
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
    fn several_workgroups_run_in_each_direction_that_a_workgroup_has() {
        assert_eq!(usual_workgroups([256, 1, 1]), [2, 1, 1]);
        assert_eq!(usual_workgroups([8, 8, 1]), [2, 3, 1]);
        assert_eq!(usual_workgroups([1, 1, 1]), [64, 1, 1]);
        assert_eq!(usual_workgroups([1, 16, 1]), [2, 3, 1]);
        assert_eq!(common_invocations([[8, 8, 1], [4, 4, 1]]), [16, 24, 1]);
        assert_eq!(common_invocations([[6, 1, 1], [4, 1, 1]]), [96, 1, 1]);
    }
}
