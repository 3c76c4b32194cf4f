//! Builds Luau's Analysis, which `check.cpp` links.
