//! Shows a value of a pass for each invocation.

use std::sync::Arc;

use super::Compute;
use crate::dispatch::{Held, Passes};
use crate::executor;
use crate::fixture::Buffer;
use crate::frame::tap::{Read, Tap, TapError, Tapped, candidates, find_or_part, prints, tapped};
use crate::path::Path;
use crate::reflect::TOLD;

/// The largest size in bytes of a storage buffer that every WebGPU device supports (`maxStorageBufferBindingSize`).
const MOST_BYTES: usize = 128 << 20;

impl Compute<'_> {
    /// Lists the `let`s and parameters that [`tap`](Self::tap) can read in the last pass, one line of text for each.
    ///
    /// # Errors
    /// Returns an error if the passes aren't valid.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn values(&self) -> Result<Vec<String>, TapError> {
        let passes = self.passes()?;
        let pass = passes.passes.last().expect("there is one");
        let all = candidates(&pass.program, &[&pass.entry_point]);
        Ok(all.iter().filter_map(|one| one.listed(&pass.program)).collect())
    }

    /// The source position of each `print` in the last pass. [`Tap::new`] accepts each position.
    ///
    /// # Errors
    /// Returns an error if the passes aren't valid.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn prints(&self) -> Result<Vec<String>, TapError> {
        let passes = self.passes()?;
        let pass = passes.passes.last().expect("there is one");
        Ok(prints(&pass.program, &[&pass.entry_point]))
    }

    /// Reads a value that each invocation of the last pass computes, on one path.
    ///
    /// ```
    /// use karat::Path;
    /// use karat::prelude::*;
    /// use karat::unstable::frame::Tap;
    ///
    /// let text = "@group(0) @binding(0) var<storage, read_write> data: array<f32>;
    ///             @compute @workgroup_size(4) fn root(@builtin(global_invocation_id) id: vec3u) {
    ///                 let own = data[id.x] + 0.5;
    ///                 data[id.x] = own * own;
    ///             }";
    /// let package = Package::from_source("m", text);
    /// let passes = package.compute().with("data", Storage::new([0.0_f32, 1.0, 4.0, 9.0]));
    /// let tapped = passes.dispatch("root", [1, 1, 1]).tap(Path::CPU, &Tap::new("own"))?;
    /// assert_eq!(tapped.lanes, [0.5_f32, 1.5, 4.5, 9.5].map(f32::to_bits));
    /// # Ok::<(), karat::unstable::frame::TapError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the pass has no such value, or the path can't run the passes.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn tap(&self, path: Path, tap: &Tap) -> Result<Tapped, TapError> {
        let mut passes: Passes = self.passes()?;
        let pass = passes.passes.last_mut().expect("there is one");
        let (program, entry_point) = (Arc::clone(&pass.program), pass.entry_point.clone());
        let found = find_or_part(&program, &[&entry_point], &tap.wanted)?;
        let width = found.0.shape()?.lanes().len() + 1;
        let size = pass.workgroup_size();
        let counts: [u32; 3] = std::array::from_fn(|k| size[k].saturating_mul(pass.workgroups[k]));
        let invocations = counts.iter().map(|count| *count as usize).product::<usize>();
        let bytes = invocations.saturating_mul(4 * width);
        if bytes > MOST_BYTES {
            let (place, text) = (found.0.place(), found.0.text.clone());
            let why = format!(
                "computed in {invocations} invocations, which need a buffer of more than {MOST_BYTES} bytes"
            );
            return Err(TapError::Untold { place, text, why });
        }
        let telling =
            program.telling_pass(&entry_point, (&found.0.value, tap.round.into()), counts);
        pass.program = Arc::new(telling.map_err(crate::dispatch::DispatchError::from)?);
        let (bindings, _) =
            pass.program.compute_entry_point(&entry_point).expect("it is one still");
        let told = bindings.into_iter().find(|binding| binding.path == TOLD);
        let number = passes.resources.len();
        pass.bindings.push((told.expect("its invocations write it"), number));
        let fixture = Buffer::zeros(bytes).into();
        passes.resources.push(Held { name: TOLD.to_owned(), fixture });
        let executor = executor::of(path).map_err(crate::dispatch::DispatchError::from)?;
        let left = executor::dispatch(executor, &passes)?;
        let words = left.into_iter().find(|(own, _)| *own == number);
        let (_, words) = words.expect("what is written is read");
        let rows = || words.chunks_exact(width);
        let times = rows().map(|row| row[width - 1].checked_sub(1)).collect();
        let lanes = rows().flat_map(|row| &row[..width - 1]).copied().collect();
        let read = Read { times, lanes, changed: None };
        let size = (counts[0], counts[1].saturating_mul(counts[2]));
        Ok(Tapped { of: "invocation", ..tapped(&program, found, tap, read, size)? })
    }
}
