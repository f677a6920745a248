//! The structs that host and kernels share, and the types of their fields.

use super::module::Description;
use naga::{ArraySize, GlobalVariable, Handle, Module, Scalar, ScalarKind, Type, TypeInner};
use std::collections::BTreeMap;

/// A struct as the host has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Struct {
    pub name: String,
    pub doc: Vec<String>,
    pub fields: Vec<Field>,
}

/// One of its fields.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    pub name: String,
    pub doc: Vec<String>,
    /// In Rust.
    pub ty: String,
    pub offset: u32,
}

/// Reads structs of one kernel.
pub struct Reader<'a> {
    /// The kernel, for messages.
    pub kernel: &'a str,
    pub module: &'a Module,
    pub found: Vec<Struct>,
}

impl Reader<'_> {
    /// The Rust type of the rows of a buffer: what it is an array of, an atomic as the number in it.
    pub fn row(&mut self, buffer: &GlobalVariable) -> String {
        let (kernel, name) = (self.kernel, buffer.name.as_deref().unwrap_or_default());
        let TypeInner::Array { base, stride, .. } = self.module.types[buffer.ty].inner else {
            panic!("kernel {kernel}: buffer {name} is no array")
        };
        let (row, size) = match self.module.types[base].inner {
            TypeInner::Atomic(scalar) => (self.host_scalar(scalar), u32::from(scalar.width)),
            _ => self.host_type(base),
        };
        assert!(size == stride, "kernel {kernel}: buffer {name} has implicit padding in each `{row}`");
        row
    }

    /// The Rust type of a value that host and kernel share, and its size in bytes. Structs in it are put into `found`.
    pub fn host_type(&mut self, handle: Handle<Type>) -> (String, u32) {
        let ty = &self.module.types[handle];
        match &ty.inner {
            TypeInner::Scalar(scalar) => (self.host_scalar(*scalar), u32::from(scalar.width)),
            TypeInner::Vector { size, scalar } => {
                let count = *size as u32;
                (format!("[{}; {count}]", self.host_scalar(*scalar)), u32::from(scalar.width) * count)
            }
            TypeInner::Array { base, size: ArraySize::Constant(count), stride } => {
                let (base, size) = self.host_type(*base);
                let kernel = self.kernel;
                assert!(size == *stride, "kernel {kernel}: an array of `{base}` has implicit padding in each value");
                (format!("[{base}; {count}]"), size * count.get())
            }
            TypeInner::Struct { span, .. } => (self.read(handle), *span),
            _ => panic!("kernel {}: the host has no type for `{}`", self.kernel, wgsl_type(self.module, handle)),
        }
    }

    fn host_scalar(&self, scalar: Scalar) -> String {
        let name = scalar_name(scalar);
        match name.as_str() {
            "f32" | "u32" | "i32" => name,
            "f16" => "F16".to_string(),
            _ => panic!("kernel {}: the host has no type for `{name}`", self.kernel),
        }
    }

    /// Reads a struct and gives its name.
    fn read(&mut self, handle: Handle<Type>) -> String {
        let (kernel, module) = (self.kernel, self.module);
        let ty = &module.types[handle];
        let TypeInner::Struct { members, span } = &ty.inner else { unreachable!("the caller found a struct") };
        let name = ty.name.clone().unwrap_or_default();
        let comments = module.doc_comments.as_deref();
        let doc = lines(comments.and_then(|all| all.types.get(&handle)));
        assert!(!doc.is_empty(), "kernel {kernel}: struct {name} needs a comment `///`");
        let (mut fields, mut end) = (Vec::new(), 0);
        for (index, member) in members.iter().enumerate() {
            let field = member.name.clone().unwrap_or_default();
            let doc = lines(comments.and_then(|all| all.struct_members.get(&(handle, index))));
            assert!(!doc.is_empty(), "kernel {kernel}: field {name}.{field} needs a comment `///`");
            let gap = member.offset - end;
            assert!(
                gap == 0,
                "kernel {kernel}: before {name}.{field} lie {gap} bytes of implicit padding; add a field"
            );
            let (ty, size) = self.host_type(member.ty);
            end = member.offset + size;
            fields.push(Field { name: field, doc, ty, offset: member.offset });
        }
        let gap = span - end;
        assert!(gap == 0, "kernel {kernel}: struct {name} ends with {gap} bytes of implicit padding; add a field");
        self.found.push(Struct { name: name.clone(), doc, fields });
        name
    }
}

/// A type as the WGSL has it.
pub fn wgsl_type(module: &Module, handle: Handle<Type>) -> String {
    let ty = &module.types[handle];
    match &ty.inner {
        TypeInner::Scalar(scalar) => scalar_name(*scalar),
        TypeInner::Atomic(scalar) => format!("atomic<{}>", scalar_name(*scalar)),
        TypeInner::Vector { size, scalar } => format!("vec{}<{}>", *size as u32, scalar_name(*scalar)),
        TypeInner::Array { base, size: ArraySize::Constant(count), .. } => {
            format!("array<{}, {count}>", wgsl_type(module, *base))
        }
        TypeInner::Array { base, .. } => format!("array<{}>", wgsl_type(module, *base)),
        _ => ty.name.clone().unwrap_or_else(|| format!("{:?}", ty.inner)),
    }
}

fn scalar_name(scalar: Scalar) -> String {
    let kind = match scalar.kind {
        ScalarKind::Float => "f",
        ScalarKind::Uint => "u",
        ScalarKind::Sint => "i",
        _ => return "bool".to_string(),
    };
    format!("{kind}{}", 8 * scalar.width)
}

/// The lines of a documentation comment without its slashes.
pub fn lines(comment: Option<&Vec<String>>) -> Vec<String> {
    comment.into_iter().flatten().map(|line| line.trim_start_matches('/').trim().to_string()).collect()
}

/// The structs of all kernels by name.
pub fn all_structs(kernels: &[Description]) -> Vec<Struct> {
    let mut all: BTreeMap<&str, (&str, &Struct)> = BTreeMap::new();
    for kernel in kernels {
        for own in &kernel.shape.structs {
            let (first, known) = *all.entry(&own.name).or_insert((&kernel.name, own));
            let name = &own.name;
            assert!(known == own, "struct {name} differs between the kernels {first} and {}", kernel.name);
        }
    }
    all.into_values().map(|(_, own)| own.clone()).collect()
}
