//! What every device must offer: WebGPU's default limits, as far as compute shaders meet them.

use crate::error::GpuError;

/// The limits that the kernels rely on, by wgpu's names.
const LIMITS: [&str; 15] = [
    "max_bind_groups",
    "max_bindings_per_bind_group",
    "max_buffer_size",
    "max_compute_invocations_per_workgroup",
    "max_compute_workgroup_size_x",
    "max_compute_workgroup_size_y",
    "max_compute_workgroup_size_z",
    "max_compute_workgroup_storage_size",
    "max_compute_workgroups_per_dimension",
    "max_storage_buffer_binding_size",
    "max_storage_buffers_per_shader_stage",
    "max_uniform_buffer_binding_size",
    "max_uniform_buffers_per_shader_stage",
    "min_storage_buffer_offset_alignment",
    "min_uniform_buffer_offset_alignment",
];

/// The first limit that is worse than WebGPU's default: its name, the default, the actual value.
fn worse_limit(offered: &wgpu::Limits) -> Option<(&'static str, u64, u64)> {
    let mut worse = None;
    let needed = wgpu::Limits::default();
    needed.check_limits_with_fail_fn(offered, false, |name, needed, offered| {
        if worse.is_none() && LIMITS.contains(&name) {
            worse = Some((name, needed, offered));
        }
    });
    worse
}

/// What an adapter lacks, in words.
pub(crate) fn unmet(
    limits: &wgpu::Limits,
    downlevel: &wgpu::DownlevelCapabilities,
) -> Option<String> {
    if !downlevel.flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS) {
        return Some("it has no compute shaders".into());
    }
    let (name, needed, offered) = worse_limit(limits)?;
    Some(format!("its limit {name} is {offered}, and WebGPU's default of {needed} is needed"))
}

/// The same for a device whose limits a host has chosen.
pub(crate) fn check(limits: &wgpu::Limits) -> Result<(), GpuError> {
    match worse_limit(limits) {
        None => Ok(()),
        Some((limit, needed, allowed)) => {
            Err(GpuError::Limit { what: "splitplane".into(), limit, needed, allowed })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_limit_that_is_needed_can_be_seen_to_be_missing() {
        let defaults = wgpu::Limits::default();
        let all = wgpu::DownlevelCapabilities::default();
        assert_eq!(unmet(&defaults, &all), None);
        let mut seen = Vec::new();
        // WebGL has no compute shaders; its features are removed here.
        let nothing = wgpu::Limits {
            max_bind_groups: 0,
            max_bindings_per_bind_group: 0,
            max_buffer_size: 0,
            max_uniform_buffer_binding_size: 0,
            max_uniform_buffers_per_shader_stage: 0,
            min_storage_buffer_offset_alignment: 4096,
            min_uniform_buffer_offset_alignment: 4096,
            ..wgpu::Limits::downlevel_webgl2_defaults()
        };
        defaults.check_limits_with_fail_fn(&nothing, false, |name, _, _| seen.push(name));
        for name in LIMITS {
            assert!(seen.contains(&name), "{name} is no limit of wgpu");
        }
    }

    #[test]
    fn an_adapter_without_compute_shaders_cannot_be_used() {
        let flags = wgpu::DownlevelFlags::all() - wgpu::DownlevelFlags::COMPUTE_SHADERS;
        let downlevel = wgpu::DownlevelCapabilities { flags, ..Default::default() };
        let reason = unmet(&wgpu::Limits::default(), &downlevel).unwrap();
        assert!(reason.contains("no compute shaders"), "{reason}");
    }

    #[test]
    fn a_limit_that_is_too_low_is_named() {
        let limits =
            wgpu::Limits { max_storage_buffers_per_shader_stage: 4, ..wgpu::Limits::default() };
        let reason = unmet(&limits, &wgpu::DownlevelCapabilities::default()).unwrap();
        assert!(reason.contains("max_storage_buffers_per_shader_stage is 4"), "{reason}");
        assert!(matches!(check(&limits), Err(GpuError::Limit { needed: 8, allowed: 4, .. })));
    }
}
