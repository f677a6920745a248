//! Writes what the host must know of the kernels, as Rust, from their WGSL alone: the table of kernels, the structs of their
//! immediate data and of buffers, and for each kernel a struct of its buffers with their names and the types of their rows.

#[path = "build/header.rs"]
mod header;
#[path = "build/layout.rs"]
mod layout;
#[path = "build/module.rs"]
mod module;
#[path = "build/write.rs"]
mod write;

/// The part of the library that makes a kernel's text. The library uses more of it.
#[allow(dead_code)]
#[path = "src"]
mod shared {
    pub mod choices;
    pub mod class;
    pub mod constants;
    pub mod import;
    pub mod layers;
    pub mod variant;
}

use module::{Description, Shape};
use shared::class::KernelSet;
use shared::import::name_of;
use shared::variant::{MatrixUnits, Variant};
use std::path::{Path, PathBuf};

fn main() {
    println!("cargo::rerun-if-changed=wgsl");
    let out = PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let files = wgsl_files("wgsl/shared");
    let shared: Vec<_> = files.iter().map(|(name, text)| (name.as_str(), text.as_str())).collect();
    let files = wgsl_files("wgsl");
    let mut kernels: Vec<_> = files
        .iter()
        .flat_map(|(file, source)| {
            kernels_of(file, source).into_iter().map(|name| describe(name, file, source, &shared))
        })
        .collect();
    assert!(!kernels.is_empty(), "wgsl/ has no kernel");
    kernels.sort_by(|a, b| a.name.cmp(&b.name));
    if let Some([one, _]) = kernels.array_windows().find(|[one, other]| one.name == other.name) {
        panic!("two kernels are called {}", one.name);
    }
    for (name, text) in [
        ("shared.rs", write::shared(&shared)),
        ("kernels.rs", write::kernels(&kernels)),
        ("types.rs", write::types(&layout::all_structs(&kernels))),
        ("bindings.rs", write::bindings(&kernels)),
    ] {
        std::fs::write(out.join(name), text).unwrap_or_else(|e| panic!("{name} cannot be written: {e}"));
    }
}

/// Name without extension and text of the WGSL files of a folder, by name.
fn wgsl_files(folder: &str) -> Vec<(String, String)> {
    let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{folder}: {e}"));
    let paths = entries.map(|entry| entry.unwrap_or_else(|e| panic!("{folder}: {e}")).path());
    let mut files: Vec<_> = paths
        .filter(|path| path.extension().is_some_and(|extension| extension == "wgsl"))
        .map(|path| (path.file_stem().unwrap_or_default().to_string_lossy().into_owned(), read(&path)))
        .collect();
    files.sort();
    files
}

/// The names of a file's kernels.
fn kernels_of<'a>(file: &'a str, source: &'a str) -> Vec<&'a str> {
    let names: Vec<_> = source.lines().filter_map(name_of).collect();
    if names.is_empty() { vec![file] } else { names }
}

/// What the host must know of a kernel, which is the same of all its forms.
fn describe(name: &str, file: &str, source: &str, shared: &[(&str, &str)]) -> Description {
    let _named = Named(name);
    assert!(name.starts_with(file), "wgsl/{file}.wgsl: the name {name} does not begin with the file's");
    let header = header::read(name, source);
    let shape = |variant: Variant| Shape::of(name, &variant.text(name, source, shared));
    let matrix = |side, lanes| Variant::Matrix(MatrixUnits { side, lanes });
    let (usual, others) = match header.set {
        // Those for matrix units have a fixed number of subgroups; the table says what 32 lanes make.
        KernelSet::Matrix => (shape(matrix(16, 32)), vec![matrix(8, 8)]),
        _ => (shape(Variant::Plain), [8, 16, 32].map(Variant::Subgroups).to_vec()),
    };
    for variant in others {
        let mut other = shape(variant);
        // The host counts workgroups of these.
        let lanes_of_8 = matches!(variant, Variant::Subgroups(8) | Variant::Matrix(MatrixUnits { lanes: 8, .. }));
        let parts = usual.workgroup.iter().zip(&mut other.workgroup);
        for (whole, part) in parts.filter(|(whole, part)| lanes_of_8 && whole.is_multiple_of(**part)) {
            *part = *whole;
        }
        assert!(other == usual, "kernel {name}: its form {variant:?} has other bindings, parameters or workgroups");
    }
    Description { name: name.to_string(), file: file.to_string(), header, shape: usual }
}

/// The kernel that is read: a panic of the library's part does not name it.
struct Named<'a>(&'a str);

impl Drop for Named<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            println!("cargo::error=the kernel {} cannot be read", self.0);
        }
    }
}
