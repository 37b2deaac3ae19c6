//! Finds the elements that compute passes write.

use super::dispatch::{in_order, options};
use crate::dispatch::{DispatchError, Passes};
use crate::reflect::BindingKind;

/// For each scalar of a buffer or texture, in order, `true` if a pass writes the scalar.
pub fn written(passes: &Passes, resource: usize) -> Result<Vec<bool>, DispatchError> {
    let mut marks: Vec<u8> = Vec::new();
    in_order(passes, &mut |pass, lowered, resources| {
        let observed = lowered.observe_races(pass.workgroups, resources, &options(), None)?;
        if let Some(stop) = observed.stopped {
            return Err(stop);
        }
        let own = pass.bindings.iter().filter(|(_, number)| *number == resource);
        for at in own.map(|(binding, _)| (binding.group, binding.binding)) {
            let texels = || {
                let size = resources.texture(at.0, at.1)?.size();
                Some(size.into_iter().map(|n| n as usize).product())
            };
            let length = resources.buffer(at.0, at.1).map(<[u8]>::len).or_else(texels);
            let length = length.expect("each binding of a pass has its resource");
            marks.resize(length, 0);
            // If a pass doesn't write a buffer, the buffer has no entry.
            let touched = observed.written.get(&at);
            (0..length)
                .filter(|at| touched.is_some_and(|touched| touched.contains(*at)))
                .for_each(|at| marks[at] = 1);
        }
        Ok(true)
    })?;
    if let Some((_, binding)) = passes.writer(resource)
        && let BindingKind::StorageTexture { format, .. } = binding.kind
    {
        // A pass writes all channels of a texel together.
        let texel = |mark| std::iter::repeat_n(mark != 0, format.channels());
        return Ok(marks.into_iter().flat_map(texel).collect());
    }
    // A scalar of any of WGSL's types isn't 0 if its first byte is 1, so each marked scalar differs from 0.
    let words: Vec<u32> = marks
        .chunks(4)
        .map(|bytes| (0..).zip(bytes).fold(0, |word, (k, byte)| word | u32::from(*byte) << (8 * k)))
        .collect();
    let lanes = passes.lanes(resource, &words).expect("passes write what they leave");
    Ok(lanes.into_iter().map(|word| word != 0).collect())
}
