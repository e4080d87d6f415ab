//! NVIDIA's compiler NVRTC, which is loaded on first use.

#![allow(unsafe_code, reason = "a library is loaded")]

use cudarc::nvrtc::{CompileError, CompileOptions, Ptx, compile_ptx_with_opts};
use plan::cuda::Kernels;
use plan::executor::Lost;

/// Architecture that kernels are compiled for; the driver translates them for the card.
const ARCHITECTURE: &str = "compute_80";

/// Whether the compiler NVRTC is found.
#[must_use]
pub fn has_compiler() -> bool {
    // SAFETY: the function opens the library and closes it again, and no thread uses it in between.
    unsafe { cudarc::nvrtc::sys::is_culib_present() }
}

/// Compiles kernels to PTX. No card is needed.
///
/// # Errors
/// A sentence with the reason why they cannot be compiled.
pub fn compile(kernels: &Kernels) -> Result<Ptx, Lost> {
    if !has_compiler() {
        let reason = "the compiler for the card is missing: the library libnvrtc is not found; the Python package \
                      nvidia-cuda-nvrtc-cu12 has it, and LD_LIBRARY_PATH has to name its folder";
        return Err(Lost {
            reason: reason.into(),
        });
    }
    let options = CompileOptions {
        // Sums are not contracted to fused multiply-adds, and division and root follow IEEE 754.
        fmad: Some(false),
        prec_div: Some(true),
        prec_sqrt: Some(true),
        ftz: Some(false),
        arch: Some(ARCHITECTURE),
        ..CompileOptions::default()
    };
    compile_ptx_with_opts(kernels.source(), options).map_err(|error| Lost {
        reason: match error {
            CompileError::CompileError { log, .. } => {
                format!(
                    "the kernels for the card cannot be compiled: {}",
                    log.to_string_lossy()
                )
            }
            other => format!("the kernels for the card cannot be compiled: {other}"),
        },
    })
}
