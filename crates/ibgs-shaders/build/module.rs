//! A kernel's module, as naga reads it.

use super::header::Header;
use super::layout::{Reader, Struct, lines, wgsl_type};
use naga::front::wgsl::{Frontend, Options};
use naga::{AddressSpace, GlobalVariable, Module, StorageAccess};

/// What the host must know of a kernel.
pub struct Description {
    pub name: String,
    /// Name of its file without extension.
    pub file: String,
    pub header: Header,
    pub shape: Shape,
}

/// What all forms of a kernel have in common.
#[derive(Debug, PartialEq, Eq)]
pub struct Shape {
    /// In binding order.
    pub bindings: Vec<Binding>,
    pub workgroup: [u32; 3],
    /// Rust type of the immediate data, and its size in bytes.
    pub immediates: Option<(String, u32)>,
    /// Structs that the host needs.
    pub structs: Vec<Struct>,
}

/// A storage buffer of a kernel.
#[derive(Debug, PartialEq, Eq)]
pub struct Binding {
    pub name: String,
    pub doc: Vec<String>,
    /// Type in WGSL.
    pub ty: String,
    /// Type of a row in Rust.
    pub row: String,
    pub writes: bool,
}

impl Shape {
    /// Reads a kernel's complete text.
    pub fn of(kernel: &str, text: &str) -> Self {
        // naga finds `///` only where no other comment comes before it.
        let is_comment = |line: &&str| line.trim_start().starts_with("//") && !line.trim_start().starts_with("///");
        let text = &text.lines().filter(|line| !is_comment(line)).collect::<Vec<_>>().join("\n");
        let options = Options { parse_doc_comments: true, ..Options::new() };
        let module = Frontend::new_with_options(options)
            .parse(text)
            .unwrap_or_else(|e| panic!("kernel {kernel}: {}", e.emit_to_string(text)));
        let [entry] = &module.entry_points[..] else { panic!("kernel {kernel} has not one entry point") };
        assert!(entry.name == "main", "kernel {kernel}: the entry point is called `{}`, not main", entry.name);
        let mut reader = Reader { kernel, module: &module, found: Vec::new() };
        let (mut bindings, mut immediates) = (Vec::new(), None);
        for (handle, variable) in module.global_variables.iter() {
            match variable.space {
                AddressSpace::Immediate => immediates = Some(reader.host_type(variable.ty)),
                AddressSpace::Storage { access } => {
                    let comments = module.doc_comments.as_deref();
                    let doc = lines(comments.and_then(|all| all.global_variables.get(&handle)));
                    let row = reader.row(variable);
                    bindings.push(binding(kernel, &module, (variable, row), doc, access));
                }
                _ => assert!(variable.binding.is_none(), "kernel {kernel}: only storage buffers can be bound"),
            }
        }
        let structs = reader.found;
        Self { bindings: in_order(kernel, bindings), workgroup: entry.workgroup_size, immediates, structs }
    }
}

fn binding(
    kernel: &str,
    module: &Module,
    (variable, row): (&GlobalVariable, String),
    doc: Vec<String>,
    access: StorageAccess,
) -> (u32, Binding) {
    let name = variable.name.clone().unwrap_or_default();
    let Some(at) = variable.binding else { panic!("kernel {kernel}: buffer {name} has no @binding") };
    assert!(at.group == 0, "kernel {kernel}: buffer {name} is not in group 0");
    let writes = access.contains(StorageAccess::STORE);
    (at.binding, Binding { name, doc, ty: wgsl_type(module, variable.ty), row, writes })
}

fn in_order(kernel: &str, mut bindings: Vec<(u32, Binding)>) -> Vec<Binding> {
    bindings.sort_by_key(|(at, _)| *at);
    let bindings = bindings.into_iter().enumerate().map(|(index, (at, binding))| {
        let name = &binding.name;
        assert!(at as usize == index, "kernel {kernel}: buffer {name} has number {at} and should have {index}");
        binding
    });
    bindings.collect()
}
