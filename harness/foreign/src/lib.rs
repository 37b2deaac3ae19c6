//! Shaders that go to a driver as they are, without wgpu's checks or translation.
//!
//! It is the only crate of Karat with `unsafe` code, and small so that it can be read whole.

/// A shader module of SPIR-V that another compiler made. wgpu neither reads nor changes it.
///
/// The SPIR-V comes from a compiler that was given naga's translation of a shader that naga found
/// valid, with its checks of bounds in it. If that compiler is wrong, the driver may crash, or read
/// and write what belongs to the process. Karat runs it because it wants to know: whoever asks for a
/// path such as `vulkan:hlsl` tests that compiler, too.
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
    // SAFETY: wgpu asks that the code be valid for the driver and keep within its buffers. A compiler
    // made it of naga's translation, which checks bounds; that this compiler is right is what the
    // caller wants to test, and can't be known before.
    unsafe { device.create_shader_module_passthrough(descriptor) }
}
