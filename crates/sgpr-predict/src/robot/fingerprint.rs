//! A robot in 32 letters.

use alloc::string::String;

use super::Robot;
use super::description::RobotDescription;

impl Robot {
    /// A number that robots share whose joints, links, limits and gravity are the same, and only
    /// those; name, frames and notes do not count. 128 bits, hexadecimal.
    ///
    /// Source: G. Fowler, L. C. Noll, K.-P. Vo, the FNV-1a hash; it finds differences, it keeps
    /// nobody out.
    pub fn fingerprint(&self) -> String {
        const PRIME: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;
        const OFFSET: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
        let text = RobotDescription::from(self.clone()).dynamics_json();
        let hash =
            text.bytes().fold(OFFSET, |hash, byte| (hash ^ u128::from(byte)).wrapping_mul(PRIME));
        format!("{hash:032x}")
    }
}

#[cfg(test)]
mod tests {
    use crate::robot::{puma560, two_link};

    #[test]
    fn the_same_robot_has_the_same_fingerprint_and_another_gravity_makes_another() {
        assert_eq!(two_link().fingerprint(), two_link().fingerprint());
        assert_ne!(two_link().fingerprint(), puma560().fingerprint());
        let tilted = two_link().with_gravity([0.0, -1e-15, -9.81].into());
        assert_ne!(tilted.fingerprint(), two_link().fingerprint());
    }
}
