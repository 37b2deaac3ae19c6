//! The elements that compute passes write.

use super::dispatch::{in_order, options};
use crate::dispatch::{DispatchError, Passes};
use crate::path::{Path, PathError};
use crate::reflect::BindingKind;

/// For each lane of a buffer, in order, whether a pass writes it.
pub(crate) fn written(passes: &Passes, resource: usize) -> Result<Vec<bool>, DispatchError> {
    let mut marks: Vec<u8> = Vec::new();
    in_order(passes, &mut |pass, lowered, resources| {
        let observed = lowered.observe_races(pass.workgroups, resources, &options(), None)?;
        if let Some(stop) = observed.stopped {
            return Err(stop);
        }
        let own = pass.bindings.iter().filter(|(_, number)| *number == resource);
        for at in own.map(|(binding, _)| (binding.group, binding.binding)) {
            let (Some(bytes), Some(touched)) =
                (resources.buffer(at.0, at.1), observed.written.get(&at))
            else {
                continue;
            };
            marks.resize(bytes.len(), 0);
            (0..bytes.len())
                .filter(|byte| touched.contains(*byte))
                .for_each(|byte| marks[byte] = 1);
        }
        Ok(true)
    })?;
    let is_texture = |(_, binding): (_, &crate::reflect::Binding)| {
        matches!(binding.kind, BindingKind::StorageTexture { .. })
    };
    if marks.is_empty() || passes.writer(resource).is_some_and(is_texture) {
        let message = "the engine notes the elements of buffers, and not of textures".to_owned();
        return Err(PathError::Route { path: Path::CPU, message }.into());
    }
    // A number whose first byte is 1 isn't 0, in each of WGSL's types.
    let words: Vec<u32> = marks
        .chunks(4)
        .map(|bytes| (0..).zip(bytes).fold(0, |word, (k, byte)| word | u32::from(*byte) << (8 * k)))
        .collect();
    let lanes = passes.lanes(resource, &words).unwrap_or_default();
    Ok(lanes.into_iter().map(|word| word != 0).collect())
}
