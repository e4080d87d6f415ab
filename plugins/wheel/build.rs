//! Where linkers want every symbol to be there, as on macOS, they are told that Python brings its own.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
