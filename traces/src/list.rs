//! A short list of fixed capacity that is `Copy`, so that it fits a ring slot.

use core::fmt;

/// Up to `N` values in order; pushing past `N` is refused.
#[derive(Clone, Copy)]
pub struct List<T: Copy + Default, const N: usize> {
    len: u16,
    rows: [T; N],
}

impl<T: Copy + Default, const N: usize> List<T, N> {
    /// The empty list.
    #[must_use]
    pub fn new() -> Self {
        const { assert!(N <= u16::MAX as usize) };
        Self { len: 0, rows: [T::default(); N] }
    }

    /// Appends a value; gives it back when the list is full.
    pub fn push(&mut self, row: T) -> Result<(), T> {
        let len = usize::from(self.len);
        if len == N {
            return Err(row);
        }
        self.rows[len] = row;
        self.len += 1;
        Ok(())
    }

    /// The values held.
    #[must_use]
    pub fn as_slice(&self) -> &[T] {
        &self.rows[..usize::from(self.len)]
    }

    /// A list of these values; `None` when there are more than `N`.
    #[must_use]
    pub fn from_slice(values: &[T]) -> Option<Self> {
        let mut list = Self::new();
        list.rows.get_mut(..values.len())?.copy_from_slice(values);
        list.len = values.len() as u16;
        Some(list)
    }
}

impl<T: Copy + Default, const N: usize> Default for List<T, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Copy + Default + PartialEq, const N: usize> PartialEq for List<T, N> {
    fn eq(&self, other: &Self) -> bool {
        self.as_slice() == other.as_slice()
    }
}

impl<T: Copy + Default + fmt::Debug, const N: usize> fmt::Debug for List<T, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.as_slice()).finish()
    }
}

impl<T: Copy + Default, const N: usize> core::ops::Deref for List<T, N> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        self.as_slice()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_list_gives_the_value_back() {
        let mut list = List::<u8, 2>::new();
        assert_eq!((list.push(1), list.push(2), list.push(3)), (Ok(()), Ok(()), Err(3)));
        assert_eq!(list.as_slice(), &[1, 2]);
        assert!(List::<u8, 2>::from_slice(&[1, 2, 3]).is_none());
    }
}
