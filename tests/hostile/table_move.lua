-- table.move over billions of indices, in C.
-- expect: done
pcall(table.move, {}, 1, 2e9, -2e9, {})
pcall(table.move, {}, 1, 2 ^ 31 - 2, 2)
