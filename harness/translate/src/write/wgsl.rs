//! Writes WGSL.

use naga::back::wgsl::{WriterFlags, write_string};

use super::{Job, Written};
use crate::{Bindings, Code};

pub(super) fn write(job: &Job<'_>) -> Result<Written, String> {
    let text = write_string(job.module, job.info, WriterFlags::empty())
        .map_err(|error| crate::shader::causes(&error))?;
    Ok(Written {
        code: Code::Text(text),
        // naga writes the whole module even if one entry point is requested.
        entry_points: job.names(),
        bindings: Bindings::kept(job.module),
        options: "WGSL, without explicit types".to_owned(),
    })
}
