//! Sums and products of vectors, in plain arithmetic and without a unit: for the fits, and for
//! whoever evaluates what they are given. Without a root, which `core` does not have.

/// The sum of two vectors.
#[inline]
pub fn plus([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ax + bx, ay + by, az + bz]
}

/// The first vector without the second.
#[inline]
pub fn minus([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ax - bx, ay - by, az - bz]
}

/// The scalar product.
#[inline]
pub fn dot([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> f64 {
    ax * bx + ay * by + az * bz
}

/// The vector product.
#[inline]
pub fn cross([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}
