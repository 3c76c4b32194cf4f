import sys,collections
T=collections.Counter();H=collections.Counter()
for fn in sys.argv[1:]:
    Y={};bat={}
    for l in open(fn):
        if l.startswith('Y '): k=l.split()[1];Y[k]=l.split(' || ')[4].count('Walker {')
        elif l.startswith('P '):
            w=l.split();bat[w[1]]=float(w[6])
    for k in Y:
        T[Y[k]]+=1;H[Y[k]]+=bat[k]>=.5
print({k:(H[k],T[k],round(H[k]/T[k],2)) for k in sorted(T)})
