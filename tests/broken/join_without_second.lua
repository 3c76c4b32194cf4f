-- Nothing behind two dots.
-- expect: check 3: a value is missing after `..`
print("x" ..)
