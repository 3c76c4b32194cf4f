-- Strings added with plus.
-- expect: run 3: `"battery "` is a string here, so it cannot be used in arithmetic
print("battery " + 3)
