//! Writes the Metal Shading Language.

use naga::back::msl::{Options, PipelineOptions, write_string};

use super::{Job, RESTRICT, RESTRICTED, Written};
use crate::{Bindings, Code};

/// The version of the Metal Shading Language. macOS 12, iOS 15 and all later systems support this version.
const VERSION: (u8, u8) = (2, 4);

pub(super) fn write(job: &Job<'_>) -> Result<Written, String> {
    let options = Options {
        lang_version: VERSION,
        fake_missing_bindings: true,
        bounds_check_policies: RESTRICT,
        zero_initialize_workgroup_memory: true,
        ..Options::default()
    };
    let pipeline = PipelineOptions {
        entry_point: job.entry_point.map(|e| (e.stage, e.name.clone())),
        ..PipelineOptions::default()
    };
    let (text, info) = write_string(job.module, job.info, &options, &pipeline)
        .map_err(|error| crate::shader::causes(&error))?;
    let mut names = Vec::new();
    for name in info.entry_point_names {
        names.push(name.map_err(|error| crate::shader::causes(&error))?);
    }
    Ok(Written {
        code: Code::Text(text),
        entry_points: names,
        bindings: Bindings::kept(job.module),
        options: format!(
            "MSL {}.{}; naga {RESTRICTED}, sets workgroup memory to zero, bounds loops and generates bindings",
            VERSION.0, VERSION.1
        ),
    })
}
