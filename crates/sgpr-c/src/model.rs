//! Models: read, asked, freed.

use std::ffi::{CStr, CString, c_char};

use sgpr_predict::model::StreamedModel;

use crate::failure::{Code, Failure, code};

/// A model.
#[derive(Debug)]
#[allow(non_camel_case_types, reason = "the name in C")]
pub struct sgpr_model {
    pub(crate) inner: StreamedModel,
    names: Vec<CString>,
}

fn handle(inner: StreamedModel) -> *mut sgpr_model {
    let joints = inner.robot().joints().iter();
    let names = joints
        .map(|joint| CString::new(joint.name.replace('\0', "_")).unwrap_or_default())
        .collect();
    Box::into_raw(Box::new(sgpr_model { inner, names }))
}

/// Reads a model. `path` is UTF-8.
///
/// # Safety
/// `path` is NULL or a C string; `model` is NULL or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_model_load(path: *const c_char, model: *mut *mut sgpr_model) -> i32 {
    code(|| {
        if path.is_null() || model.is_null() {
            return Err(Failure::null(if path.is_null() { "path" } else { "model" }));
        }
        // SAFETY: not null, and the caller says that it ends in a zero.
        let path = unsafe { CStr::from_ptr(path) };
        let path = path.to_str().map_err(|_| Failure::new(Code::BadModel, &"path: not UTF-8"))?;
        let inner =
            StreamedModel::load(path).map_err(|error| Failure::new(Code::BadModel, &error))?;
        // SAFETY: not null, and the caller says that it may be written.
        unsafe { *model = handle(inner) };
        Ok(())
    })
}

/// Reads a model from the content of a file.
///
/// # Safety
/// `bytes` is NULL or has `length` bytes; `model` is NULL or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_model_from_bytes(
    bytes: *const u8,
    length: usize,
    model: *mut *mut sgpr_model,
) -> i32 {
    code(|| {
        if bytes.is_null() || model.is_null() {
            return Err(Failure::null(if bytes.is_null() { "bytes" } else { "model" }));
        }
        if length > isize::MAX as usize {
            return Err(Failure::new(Code::WrongLength, &"length: more than memory has"));
        }
        // SAFETY: not null, and the caller says that there are so many.
        let bytes = unsafe { std::slice::from_raw_parts(bytes, length) };
        let inner = StreamedModel::from_bytes(bytes, "bytes")
            .map_err(|error| Failure::new(Code::BadModel, &error))?;
        // SAFETY: not null, and the caller says that it may be written.
        unsafe { *model = handle(inner) };
        Ok(())
    })
}

/// Frees a model; predictors of it stay valid.
///
/// # Safety
/// `model` is NULL or was made here, and is not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_model_free(model: *mut sgpr_model) {
    if !model.is_null() {
        // SAFETY: made by `Box::into_raw`, and given back once.
        drop(unsafe { Box::from_raw(model) });
    }
}

/// Number of joints; 0 for NULL.
///
/// # Safety
/// `model` is NULL or was made here.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_model_joints(model: *const sgpr_model) -> usize {
    // SAFETY: NULL or valid, as the caller says.
    unsafe { model.as_ref() }.map_or(0, |model| model.names.len())
}

/// Name of a joint, UTF-8, valid as long as the model; NULL if there is none.
///
/// # Safety
/// `model` is NULL or was made here.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_model_joint_name(
    model: *const sgpr_model,
    joint: usize,
) -> *const c_char {
    // SAFETY: NULL or valid, as the caller says.
    let name = unsafe { model.as_ref() }.and_then(|model| model.names.get(joint));
    name.map_or(std::ptr::null(), |name| name.as_ptr())
}

/// Whether the model has Gaussian processes of what its physics leaves over, so that its torques
/// have a standard deviation: 1 or 0; 0 for NULL.
///
/// # Safety
/// `model` is NULL or was made here.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sgpr_model_learned(model: *const sgpr_model) -> i32 {
    // SAFETY: NULL or valid, as the caller says.
    unsafe { model.as_ref() }.map_or(0, |model| i32::from(model.inner.learned()))
}
