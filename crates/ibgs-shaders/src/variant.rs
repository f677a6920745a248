//! The complete text of a kernel, which depends on what the device has.

use super::constants::constants;
use super::import::resolve;

/// What the matrix units of an adapter multiply at once (cooperative matrices): `side` x `side` halves, summed in float32.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MatrixUnits {
    /// Rows and columns: 8 or 16.
    pub side: u32,
    /// Lanes of a subgroup.
    pub lanes: u32,
}

impl MatrixUnits {
    /// What a kernel with this text needs. Those that only prepare or sum what the units multiply have no matrices, and run
    /// where nothing but halves is there.
    fn constants(self, text: &str) -> String {
        let Self { side, lanes } = self;
        let sizes = format!("const SIDE: u32 = {side}u;\nconst LANES: u32 = {lanes}u;\n");
        if !["MatrixA", "MatrixB", "MatrixC"].iter().any(|matrix| text.contains(matrix)) {
            return format!("enable f16;\n{sizes}");
        }
        format!(
            "enable f16;\nenable wgpu_cooperative_matrix;\n{sizes}\
             alias MatrixA = coop_mat{side}x{side}<f16, A>;\nalias MatrixB = coop_mat{side}x{side}<f16, B>;\n\
             alias MatrixC = coop_mat{side}x{side}<f32, C>;\n"
        )
    }
}

/// A form of a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// For every device.
    Plain,
    /// For devices whose subgroups all have this number of lanes.
    Subgroups(u32),
    /// For devices with these matrix units.
    Matrix(MatrixUnits),
}

impl Variant {
    /// Shared constants, imported files, the kernel; `source`: the text of its file, `shared`: name and text of the files that it may
    /// import.
    pub fn text(self, kernel: &str, source: &str, shared: &[(&str, &str)]) -> String {
        match self {
            Self::Plain => format!("{}{}", constants(), resolve(kernel, source, &[], shared)),
            Self::Subgroups(lanes) => {
                let defined: &[_] = if lanes == 8 { &["SUBGROUPS", "NARROW"] } else { &["SUBGROUPS"] };
                format!("const LANES: u32 = {lanes}u;\n{}{}", constants(), resolve(kernel, source, defined, shared))
            }
            Self::Matrix(units) => {
                let text = resolve(kernel, source, &[], shared);
                format!("{}{}{text}", units.constants(&text), constants())
            }
        }
    }
}
