-- A local variable of an inner block.
-- expect: check 7: 'level' is not known here
if robot.docked() then
	local level = 5
	print(level)
end
print(level)
