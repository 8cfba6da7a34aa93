def minimised(*a): raise NotImplementedError
