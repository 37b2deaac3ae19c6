//! Passes shaders to a driver unchanged, without wgpu's checks or translation.
//!
//! This is the only crate of Karat with `unsafe` code. It is small, so that you can read all of it.

/// Makes a shader module from the SPIR-V of another compiler. wgpu neither reads nor changes the SPIR-V.
///
/// Before this call, naga has validated the WGSL shader and translated it with bounds checks, and the other compiler
/// has compiled the translation to SPIR-V. If that compiler has a bug, the driver may crash, or read and write other
/// memory of the process. Karat takes this risk: a path such as `vulkan:hlsl` exists to test that compiler, too.
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
    // SAFETY: wgpu requires that the code is valid for the driver and stays within its buffers. A compiler made the
    // code from naga's translation, which checks bounds. The caller tests this compiler, so the code may be invalid.
    unsafe { device.create_shader_module_passthrough(descriptor) }
}
