//! Tuples: independent domains side by side.

use super::{Domain, Source};

/// Combinations of edges that are tried first; more than this are left to the draws, which reach
/// every edge of every part by their bias.
const COMBINATIONS: usize = 1024;

/// The arguments of a function that has none.
impl Domain for () {
    type Value = ();
    fn draw(&self, _: &mut Source) -> Option<()> {
        Some(())
    }
    fn size(&self) -> Option<u64> {
        Some(1)
    }
    fn nth(&self, index: u64) -> Option<()> {
        (index == 0).then_some(())
    }
}

macro_rules! product {
    ($(($($name:ident $index:tt),+))*) => {$(
        impl<$($name: Domain),+> Domain for ($($name,)+) {
            type Value = ($($name::Value,)+);

            fn draw(&self, source: &mut Source) -> Option<Self::Value> {
                Some(($(self.$index.draw(source)?,)+))
            }

            fn edges(&self) -> Vec<Self::Value> {
                let edges = ($(self.$index.edges(),)+);
                // Where all combinations are too many, the two ends of each part are combined.
                let full: usize = [$(edges.$index.len()),+].iter().product();
                let ends = if full <= COMBINATIONS { usize::MAX } else { 2 };
                let lengths = [$(edges.$index.len().min(ends)),+];
                let total: usize = lengths.iter().product();
                (0..total.min(COMBINATIONS))
                    .map(|mut rest| {
                        let combination = ($({
                            let length = lengths[$index];
                            let value = edges.$index[rest % length].clone();
                            rest /= length;
                            value
                        },)+);
                        let _ = rest; // 0: the last part leaves none
                        combination
                    })
                    .collect()
            }

            fn is_empty(&self) -> bool {
                $(self.$index.is_empty())||+
            }

            fn size(&self) -> Option<u64> {
                Some(1_u64)$(.and_then(|size| size.checked_mul(self.$index.size()?)))+
            }

            #[expect(unused_assignments, reason = "the last part leaves no rest")]
            fn nth(&self, mut index: u64) -> Option<Self::Value> {
                if index >= self.size()? {
                    return None;
                }
                Some(($({
                    let size = self.$index.size()?;
                    let value = self.$index.nth(index % size)?;
                    index /= size;
                    value
                },)+))
            }
        }
    )*};
}

product! {
    (A 0)
    (A 0, B 1)
    (A 0, B 1, C 2)
    (A 0, B 1, C 2, D 3)
    (A 0, B 1, C 2, D 3, E 4)
    (A 0, B 1, C 2, D 3, E 4, F 5)
}
