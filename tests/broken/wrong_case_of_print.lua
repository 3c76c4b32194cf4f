-- Names keep to small letters.
-- expect: check 3: unknown name 'Print'; did you mean 'print'?
Print("hello")
