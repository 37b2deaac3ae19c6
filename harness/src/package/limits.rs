//! WebGPU's limits on a shader's resources.

use std::collections::BTreeMap;

use crate::diagnostic::nearest;

/// A limit with WebGPU's name, and its values by default and in compatibility mode (WebGPU, 3.6.2 "Limits").
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Limit {
    pub(crate) name: &'static str,
    core: u64,
    compatibility: u64,
}

macro_rules! limits {
    ($($constant:ident = $name:literal: $core:literal, $compatibility:literal;)*) => {
        impl Limit {
            $(pub(crate) const $constant: Self =
                Self { name: $name, core: $core, compatibility: $compatibility };)*
            pub(crate) const ALL: &[Self] = &[$(Self::$constant),*];
        }
    };
}

limits! {
    BIND_GROUPS = "maxBindGroups": 4, 4;
    BINDINGS = "maxBindingsPerBindGroup": 1000, 1000;
    SAMPLED_TEXTURES = "maxSampledTexturesPerShaderStage": 16, 16;
    SAMPLERS = "maxSamplersPerShaderStage": 16, 16;
    STORAGE_BUFFERS = "maxStorageBuffersPerShaderStage": 8, 8;
    STORAGE_BUFFERS_IN_VERTEX = "maxStorageBuffersInVertexStage": 8, 0;
    STORAGE_BUFFERS_IN_FRAGMENT = "maxStorageBuffersInFragmentStage": 8, 4;
    STORAGE_TEXTURES = "maxStorageTexturesPerShaderStage": 4, 4;
    STORAGE_TEXTURES_IN_VERTEX = "maxStorageTexturesInVertexStage": 4, 0;
    STORAGE_TEXTURES_IN_FRAGMENT = "maxStorageTexturesInFragmentStage": 4, 4;
    UNIFORM_BUFFERS = "maxUniformBuffersPerShaderStage": 12, 12;
    UNIFORM_SIZE = "maxUniformBufferBindingSize": 65_536, 16_384;
    STORAGE_SIZE = "maxStorageBufferBindingSize": 134_217_728, 134_217_728;
    VERTEX_ATTRIBUTES = "maxVertexAttributes": 16, 16;
    INTER_STAGE = "maxInterStageShaderVariables": 16, 15;
    COLOR_ATTACHMENTS = "maxColorAttachments": 8, 4;
    WORKGROUP_STORAGE = "maxComputeWorkgroupStorageSize": 16_384, 16_384;
    INVOCATIONS = "maxComputeInvocationsPerWorkgroup": 256, 128;
    WORKGROUP_X = "maxComputeWorkgroupSizeX": 256, 128;
    WORKGROUP_Y = "maxComputeWorkgroupSizeY": 256, 128;
    WORKGROUP_Z = "maxComputeWorkgroupSizeZ": 64, 64;
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Limits {
    /// `true` if the limits of compatibility mode replace the default limits.
    pub(crate) compatibility: bool,
    /// Values of limits from `karat.toml`, by the limits' names.
    named: BTreeMap<String, u64>,
    /// `true` if `karat.toml` has the table `[limits]`. With this table, a shader that exceeds a limit is invalid.
    pub(crate) stated: bool,
}

impl Limits {
    /// The limits that every WebGPU device supports: WebGPU's default limits, or the limits of compatibility mode.
    pub(crate) fn usual(compatibility: bool) -> Self {
        Self { compatibility, ..Self::default() }
    }

    pub(super) fn of(written: BTreeMap<String, toml::Value>) -> Result<Self, String> {
        let mut limits = Self { stated: true, ..Self::default() };
        for (name, value) in written {
            if name == "mode" {
                limits.compatibility = match value.as_str() {
                    Some("core") => false,
                    Some("compatibility") => true,
                    _ => {
                        return Err(
                            "`mode` of `[limits]` must be \"core\" or \"compatibility\"".to_owned()
                        );
                    }
                };
                continue;
            }
            if !Limit::ALL.iter().any(|limit| limit.name == name) {
                // wgpu spells the names differently: `max_bind_groups`.
                let camel = name.split('_').filter(|part| !part.is_empty()).enumerate();
                let camel: String = camel.map(|(at, part)| capital(part, at > 0)).collect();
                let names = Limit::ALL.iter().map(|limit| limit.name);
                let near = nearest(&camel, names.clone());
                return Err(match near {
                    Some(near) => {
                        format!("`[limits]` can't have the key `{name}`; did you mean `{near}`?")
                    }
                    None => {
                        let names = names.collect::<Vec<_>>().join(", ");
                        format!(
                            "`[limits]` can't have the key `{name}`; its keys are `mode`, {names}"
                        )
                    }
                });
            }
            let number = value.as_integer().and_then(|number| u64::try_from(number).ok());
            let number = number.ok_or_else(|| {
                format!("the limit `{name}` must be a whole number of at least 0")
            })?;
            limits.named.insert(name, number);
        }
        Ok(limits)
    }

    pub(crate) fn value(&self, limit: Limit) -> u64 {
        // WebGPU, 3.6.2: outside of compatibility mode, the vertex and fragment stages have the same limits as
        // all stages.
        let limit = match limit {
            limit if self.compatibility || self.named.contains_key(limit.name) => limit,
            Limit::STORAGE_BUFFERS_IN_VERTEX | Limit::STORAGE_BUFFERS_IN_FRAGMENT => {
                Limit::STORAGE_BUFFERS
            }
            Limit::STORAGE_TEXTURES_IN_VERTEX | Limit::STORAGE_TEXTURES_IN_FRAGMENT => {
                Limit::STORAGE_TEXTURES
            }
            limit => limit,
        };
        let usual = if self.compatibility { limit.compatibility } else { limit.core };
        self.named.get(limit.name).copied().unwrap_or(usual)
    }

    /// The origin of a limit's value, as text for messages: `WebGPU's default`.
    pub(crate) fn source(&self, limit: Limit) -> &'static str {
        match (self.named.contains_key(limit.name), self.compatibility) {
            (true, _) => "karat.toml's",
            (false, true) => "compatibility mode's",
            (false, false) => "WebGPU's default",
        }
    }
}

fn capital(word: &str, is_one: bool) -> String {
    let mut letters = word.chars();
    match letters.next() {
        Some(first) if is_one => first.to_uppercase().chain(letters).collect(),
        _ => word.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 205
    #[test]
    fn limits_are_those_of_the_mode_unless_they_are_named() {
        let read = |text: &str| Limits::of(toml::from_str(text).expect("TOML"));
        let usual = Limits::default();
        assert_eq!(usual.value(Limit::INVOCATIONS), 256);
        let limits =
            read("mode = \"compatibility\"\nmaxComputeWorkgroupSizeX = 512").expect("limits");
        let values = [Limit::INVOCATIONS, Limit::WORKGROUP_X].map(|limit| limits.value(limit));
        assert_eq!(values, [128, 512]);
        for (text, part) in [
            ("mode = \"web\"", "\"core\" or \"compatibility\""),
            ("maxBindGroup = 4", "did you mean `maxBindGroups`?"),
            ("max_bind_groups = 4", "did you mean `maxBindGroups`?"),
            ("memory = 4", "its keys are `mode`, maxBindGroups"),
            ("maxBindGroups = -1", "a whole number of at least 0"),
            ("maxBindGroups = \"4\"", "a whole number of at least 0"),
        ] {
            let error = read(text).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
