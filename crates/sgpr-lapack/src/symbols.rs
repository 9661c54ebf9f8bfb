//! The boundary: Fortran's calling convention, every argument a pointer.
#![allow(unsafe_code)]

use std::slice::{from_raw_parts, from_raw_parts_mut};

use crate::blas::{self, Op, Triangle, View};
use crate::lapack::{self, NoFactor, Svd};

fn op(letter: u8) -> Op {
    if letter.eq_ignore_ascii_case(&b'N') { Op::Plain } else { Op::Transposed }
}

fn triangle(letter: u8) -> Triangle {
    if letter.eq_ignore_ascii_case(&b'U') { Triangle::Upper } else { Triangle::Lower }
}

/// Numbers between the first and the last entry of a matrix, or of a vector with columns of one
/// number.
fn extent(rows: usize, columns: usize, ld: usize) -> usize {
    if rows == 0 || columns == 0 { 0 } else { (columns - 1) * ld + rows }
}

/// Rows and columns in memory of a matrix that enters as `[rows, columns]`.
fn stored(op: Op, rows: usize, columns: usize) -> (usize, usize) {
    if op == Op::Plain { (rows, columns) } else { (columns, rows) }
}

fn info(result: Result<(), NoFactor>) -> i32 {
    result.map_or_else(|NoFactor(position)| position as i32, |()| 0)
}

/// The symbols of one precision.
///
/// SAFETY, for every one of them: the caller keeps to the definition of the BLAS or LAPACK routine
/// of that name, which says that scalars and sizes can be read and that arrays hold at least the
/// numbers between their first and last entry; that is exactly what is read and written. Arrays
/// that are written overlap no other, again by definition.
macro_rules! symbols {
    ($T:ty, $gemm:ident, $gemv:ident, $symv:ident, $syrk:ident, $syr2k:ident, $potrf:ident, $potrs:ident, $gesv:ident,
     $syevr:ident, $gesdd:ident, $gesvd:ident) => {
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $gemm(
            transa: *const u8,
            transb: *const u8,
            m: *const i32,
            n: *const i32,
            k: *const i32,
            alpha: *const $T,
            a: *const $T,
            lda: *const i32,
            b: *const $T,
            ldb: *const i32,
            beta: *const $T,
            c: *mut $T,
            ldc: *const i32,
        ) {
            // SAFETY: as above.
            unsafe {
                let (opa, opb) = (op(*transa), op(*transb));
                let (m, n, k) = (*m as usize, *n as usize, *k as usize);
                let (lda, ldb, ldc) = (*lda as usize, *ldb as usize, *ldc as usize);
                let ((ra, ca), (rb, cb)) = (stored(opa, m, k), stored(opb, k, n));
                let a = View { data: from_raw_parts(a, extent(ra, ca, lda)), ld: lda, op: opa };
                let b = View { data: from_raw_parts(b, extent(rb, cb, ldb)), ld: ldb, op: opb };
                let c = from_raw_parts_mut(c, extent(m, n, ldc));
                blas::gemm([m, n, k], *alpha, a, b, *beta, c, ldc);
            }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn $gemv(
            trans: *const u8,
            m: *const i32,
            n: *const i32,
            alpha: *const $T,
            a: *const $T,
            lda: *const i32,
            x: *const $T,
            incx: *const i32,
            beta: *const $T,
            y: *mut $T,
            incy: *const i32,
        ) {
            // SAFETY: as above; the caller uses positive increments only.
            unsafe {
                let (m, n, lda, op) = (*m as usize, *n as usize, *lda as usize, op(*trans));
                let (rows, columns) = stored(op, m, n);
                let (incx, incy) = (*incx as usize, *incy as usize);
                let a = View { data: from_raw_parts(a, extent(m, n, lda)), ld: lda, op };
                let x = from_raw_parts(x, extent(1, columns, incx));
                let y = from_raw_parts_mut(y, extent(1, rows, incy));
                blas::gemv([rows, columns], *alpha, a, x, *beta, y, [incx, incy]);
            }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn $symv(
            uplo: *const u8,
            n: *const i32,
            alpha: *const $T,
            a: *const $T,
            lda: *const i32,
            x: *const $T,
            incx: *const i32,
            beta: *const $T,
            y: *mut $T,
            incy: *const i32,
        ) {
            // SAFETY: as above; the caller uses positive increments only.
            unsafe {
                let (n, lda, incx, incy) =
                    (*n as usize, *lda as usize, *incx as usize, *incy as usize);
                let a = View::plain(from_raw_parts(a, extent(n, n, lda)), lda);
                let x = from_raw_parts(x, extent(1, n, incx));
                let y = from_raw_parts_mut(y, extent(1, n, incy));
                blas::symv(triangle(*uplo), n, *alpha, a, x, *beta, y, [incx, incy]);
            }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn $syrk(
            uplo: *const u8,
            trans: *const u8,
            n: *const i32,
            k: *const i32,
            alpha: *const $T,
            a: *const $T,
            lda: *const i32,
            beta: *const $T,
            c: *mut $T,
            ldc: *const i32,
        ) {
            // SAFETY: as above.
            unsafe {
                let (n, k, lda, ldc, op) =
                    (*n as usize, *k as usize, *lda as usize, *ldc as usize, op(*trans));
                let (rows, columns) = stored(op, n, k);
                let a = View { data: from_raw_parts(a, extent(rows, columns, lda)), ld: lda, op };
                let c = from_raw_parts_mut(c, extent(n, n, ldc));
                blas::syrk(triangle(*uplo), [n, k], *alpha, a, *beta, c, ldc);
            }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn $syr2k(
            uplo: *const u8,
            trans: *const u8,
            n: *const i32,
            k: *const i32,
            alpha: *const $T,
            a: *const $T,
            lda: *const i32,
            b: *const $T,
            ldb: *const i32,
            beta: *const $T,
            c: *mut $T,
            ldc: *const i32,
        ) {
            // SAFETY: as above.
            unsafe {
                let (n, k, op) = (*n as usize, *k as usize, op(*trans));
                let (lda, ldb, ldc) = (*lda as usize, *ldb as usize, *ldc as usize);
                let (rows, columns) = stored(op, n, k);
                let a = View { data: from_raw_parts(a, extent(rows, columns, lda)), ld: lda, op };
                let b = View { data: from_raw_parts(b, extent(rows, columns, ldb)), ld: ldb, op };
                let c = from_raw_parts_mut(c, extent(n, n, ldc));
                blas::syr2k(triangle(*uplo), [n, k], *alpha, a, b, *beta, c, ldc);
            }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn $potrf(
            uplo: *const u8,
            n: *const i32,
            a: *mut $T,
            lda: *const i32,
            status: *mut i32,
        ) {
            // SAFETY: as above.
            unsafe {
                let (n, lda) = (*n as usize, *lda as usize);
                *status = info(lapack::potrf(
                    triangle(*uplo),
                    n,
                    from_raw_parts_mut(a, extent(n, n, lda)),
                    lda,
                ));
            }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn $potrs(
            uplo: *const u8,
            n: *const i32,
            nrhs: *const i32,
            a: *const $T,
            lda: *const i32,
            b: *mut $T,
            ldb: *const i32,
            status: *mut i32,
        ) {
            // SAFETY: as above.
            unsafe {
                let (n, columns, lda, ldb) =
                    (*n as usize, *nrhs as usize, *lda as usize, *ldb as usize);
                let a = View::plain(from_raw_parts(a, extent(n, n, lda)), lda);
                let b = from_raw_parts_mut(b, extent(n, columns, ldb));
                lapack::potrs(triangle(*uplo), n, columns, a, b, ldb);
                *status = 0;
            }
        }

        #[unsafe(no_mangle)]
        unsafe extern "C" fn $gesv(
            n: *const i32,
            nrhs: *const i32,
            a: *mut $T,
            lda: *const i32,
            ipiv: *mut i32,
            b: *mut $T,
            ldb: *const i32,
            status: *mut i32,
        ) {
            // SAFETY: as above.
            unsafe {
                let (n, columns, lda, ldb) =
                    (*n as usize, *nrhs as usize, *lda as usize, *ldb as usize);
                let a = from_raw_parts_mut(a, extent(n, n, lda));
                let b = from_raw_parts_mut(b, extent(n, columns, ldb));
                *status =
                    info(lapack::gesv(n, columns, a, lda, from_raw_parts_mut(ipiv, n), b, ldb));
            }
        }

        /// All eigenvalues (`range` A); others, which the cone never asks for, are refused as
        /// argument 2.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $syevr(
            jobz: *const u8,
            range: *const u8,
            uplo: *const u8,
            n: *const i32,
            a: *mut $T,
            lda: *const i32,
            _vl: *const $T,
            _vu: *const $T,
            _il: *const i32,
            _iu: *const i32,
            _abstol: *const $T,
            m: *mut i32,
            w: *mut $T,
            z: *mut $T,
            ldz: *const i32,
            isuppz: *mut i32,
            work: *mut $T,
            lwork: *const i32,
            iwork: *mut i32,
            liwork: *const i32,
            status: *mut i32,
        ) {
            // SAFETY: as above; a query (lwork or liwork -1) touches the first number of either
            // work array only.
            unsafe {
                *status = 0;
                if *lwork == -1 || *liwork == -1 {
                    (*work, *iwork) = (1.0, 1);
                    return;
                }
                if !(*range).eq_ignore_ascii_case(&b'A') {
                    *status = -2;
                    return;
                }
                let (size, lda) = (*n as usize, *lda as usize);
                let a = View::plain(from_raw_parts(a, extent(size, size, lda)), lda);
                let Some((values, vectors)) = lapack::symmetric_eigen(triangle(*uplo), size, a)
                else {
                    *status = 1;
                    return;
                };
                *m = *n;
                from_raw_parts_mut(w, size).copy_from_slice(&values);
                if (*jobz).eq_ignore_ascii_case(&b'V') {
                    let ldz = *ldz as usize;
                    let z = from_raw_parts_mut(z, extent(size, size, ldz));
                    for (k, column) in vectors.chunks_exact(size.max(1)).enumerate() {
                        z[k * ldz..][..size].copy_from_slice(column);
                        let support = from_raw_parts_mut(isuppz, 2 * size);
                        (support[2 * k], support[2 * k + 1]) = (1, *n);
                    }
                }
            }
        }

        /// The thin decomposition (`jobz` S); others, which the cone never asks for, are refused as
        /// argument 1.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $gesdd(
            jobz: *const u8,
            m: *const i32,
            n: *const i32,
            a: *mut $T,
            lda: *const i32,
            s: *mut $T,
            u: *mut $T,
            ldu: *const i32,
            vt: *mut $T,
            ldvt: *const i32,
            work: *mut $T,
            lwork: *const i32,
            _iwork: *mut i32,
            status: *mut i32,
        ) {
            // SAFETY: as above; a query (lwork -1) touches the first number of the work array only.
            unsafe {
                *status = 0;
                if *lwork == -1 {
                    *work = 1.0;
                    return;
                }
                if !(*jobz).eq_ignore_ascii_case(&b'S') {
                    *status = -1;
                    return;
                }
                let (m, n) = (*m as usize, *n as usize);
                let (k, lda, ldu, ldvt) = (m.min(n), *lda as usize, *ldu as usize, *ldvt as usize);
                let Some(Svd { u: left, values, vt: right }) =
                    lapack::svd(m, n, View::plain(from_raw_parts(a, extent(m, n, lda)), lda))
                else {
                    *status = 1;
                    return;
                };
                from_raw_parts_mut(s, k).copy_from_slice(&values);
                let (u, vt) = (
                    from_raw_parts_mut(u, extent(m, k, ldu)),
                    from_raw_parts_mut(vt, extent(k, n, ldvt)),
                );
                left.chunks_exact(m.max(1))
                    .enumerate()
                    .for_each(|(j, c)| u[j * ldu..][..m].copy_from_slice(c));
                right
                    .chunks_exact(k.max(1))
                    .enumerate()
                    .for_each(|(j, c)| vt[j * ldvt..][..k].copy_from_slice(c));
            }
        }

        /// As `?gesdd`, with one letter for each side.
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $gesvd(
            jobu: *const u8,
            jobvt: *const u8,
            m: *const i32,
            n: *const i32,
            a: *mut $T,
            lda: *const i32,
            s: *mut $T,
            u: *mut $T,
            ldu: *const i32,
            vt: *mut $T,
            ldvt: *const i32,
            work: *mut $T,
            lwork: *const i32,
            status: *mut i32,
        ) {
            // SAFETY: as above; `?gesdd` does not touch the integer work array.
            unsafe {
                if !(*jobvt).eq_ignore_ascii_case(&b'S') {
                    *status = -2;
                    return;
                }
                $gesdd(
                    jobu,
                    m,
                    n,
                    a,
                    lda,
                    s,
                    u,
                    ldu,
                    vt,
                    ldvt,
                    work,
                    lwork,
                    std::ptr::null_mut(),
                    status,
                );
            }
        }
    };
}

symbols!(
    f32, sgemm_, sgemv_, ssymv_, ssyrk_, ssyr2k_, spotrf_, spotrs_, sgesv_, ssyevr_, sgesdd_,
    sgesvd_
);
symbols!(
    f64, dgemm_, dgemv_, dsymv_, dsyrk_, dsyr2k_, dpotrf_, dpotrs_, dgesv_, dsyevr_, dgesdd_,
    dgesvd_
);

/// A shared library shows these names to nobody: another BLAS in the process keeps its own.
#[cfg(target_os = "linux")]
macro_rules! hidden {
    ($($name:literal)*) => { $(std::arch::global_asm!(concat!(".hidden ", $name));)* };
}

#[cfg(target_os = "linux")]
hidden! {
    "sgemm_" "sgemv_" "ssymv_" "ssyrk_" "ssyr2k_" "spotrf_" "spotrs_" "sgesv_" "ssyevr_" "sgesdd_" "sgesvd_"
    "dgemm_" "dgemv_" "dsymv_" "dsyrk_" "dsyr2k_" "dpotrf_" "dpotrs_" "dgesv_" "dsyevr_" "dgesdd_" "dgesvd_"
}
