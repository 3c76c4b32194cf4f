-- wrong: It has not driven the first side
for side = 1, 4 do
	print("drive", 40)
	print("left", 90)
end
