//! Passes shaders to a driver unchanged, without wgpu's checks or translation.
//!
//! This is the only crate of Karat with `unsafe` code. It is small, so that you can read all of it.

/// A shader module from SPIR-V that another compiler made. wgpu neither reads nor changes the SPIR-V.
///
/// That compiler's input was naga's translation of a shader that naga found valid, with naga's bounds checks in it. If
/// the compiler has a bug, the driver may crash, or read and write other memory of the process. Karat runs it all the
/// same: a path such as `vulkan:hlsl` exists to test that compiler, too.
#[must_use]
#[expect(unsafe_code, reason = "wgpu has no other way to hand SPIR-V to a driver unchanged")]
pub fn spirv_as_it_is(
    device: &wgpu::Device,
    words: &[u32],
    entry_point: &str,
    workgroup_size: (u32, u32, u32),
) -> wgpu::ShaderModule {
    let entry_points =
        [wgpu::PassthroughShaderEntryPoint { name: entry_point.into(), workgroup_size }];
    let descriptor = wgpu::ShaderModuleDescriptorPassthrough {
        label: None,
        entry_points: (&entry_points).into(),
        spirv: Some(words.into()),
        ..Default::default()
    };
    // SAFETY: wgpu requires that the code is valid for the driver and stays within its buffers. A compiler made it from
    // naga's translation, which checks bounds. The caller wants to test whether that compiler is right, so it can't be
    // known before.
    unsafe { device.create_shader_module_passthrough(descriptor) }
}
