-- table.concat of one text many times over.
-- expect: memory
local parts = table.create(10000, ("x"):rep(10000))
return table.concat(parts)
