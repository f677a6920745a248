//! Matrix units: wgpu's cooperative matrices, an experimental feature.

use ibgs_shaders::MatrixUnits;

/// Bytes of workgroup memory that our kernels for the matrix units need at 16 x 16.
const MATRIX_MEMORY: u32 = 47 << 10;

/// Subgroups of the largest of their workgroups.
const SUBGROUPS: u32 = 9;

/// The matrix units that our kernels can use: halves summed in float32, squares, a fixed subgroup size.
pub(super) fn matrix_units(adapter: &wgpu::Adapter) -> Option<MatrixUnits> {
    use wgpu::CooperativeScalarType::{F16, F32};
    let (info, limits) = (adapter.get_info(), adapter.limits());
    let features =
        wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX | wgpu::Features::SHADER_F16 | wgpu::Features::SUBGROUP_BARRIER;
    let lanes = info.subgroup_min_size;
    let threads = SUBGROUPS * lanes <= limits.max_compute_invocations_per_workgroup;
    if !adapter.features().contains(features) || lanes != info.subgroup_max_size || lanes < 8 || !threads {
        return None;
    }
    let side = |side: u32| {
        let found = adapter.cooperative_matrix_properties().iter().any(|m| {
            let square = [m.m_size, m.n_size, m.k_size] == [side; 3];
            square && m.ab_type == F16 && m.cr_type == F32 && !m.saturating_accumulation
        });
        let memory = MATRIX_MEMORY * side / 16;
        // A lane has two groups of four values of a matrix.
        found && 8 * lanes == side * side && limits.max_compute_workgroup_storage_size >= memory
    };
    [16, 8].into_iter().find(|&s| side(s)).map(|side| MatrixUnits { side, lanes })
}

/// wgpu's token for experimental features. We use only cooperative matrices, in our own kernels, and tests check each
/// of their memory accesses.
#[expect(unsafe_code, reason = "wgpu asks for it")]
pub(super) fn experimental_features() -> wgpu::ExperimentalFeatures {
    // SAFETY: the only requirement is to accept that these features may have bugs.
    unsafe { wgpu::ExperimentalFeatures::enabled() }
}
