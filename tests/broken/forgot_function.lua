-- A handler without the word function.
-- expect: check 3: the word `function` is missing before `on_frame`
on_frame(frame)
	print(frame.width)
end
