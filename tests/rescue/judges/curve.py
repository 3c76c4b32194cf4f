import sys
# Share of robots that would be home if low were L: used <= start-(30-L)
used=[];n=0
for fn in sys.argv[1:]:
    first={};last={};t={}
    for l in open(fn):
        w=l.split()
        if w and w[0]=='P':
            b=float(w[6]); first.setdefault(w[1],b); last[w[1]]=b; t[w[1]]=float(w[2])
    for k in first:
        n+=1
        if last[k]>=.5: used.append((first[k]-last[k],first[k],t[k]))
print(n,'home',len(used))
for L in (20,22,24,25,26,28,30): print(L,sum(u<=f-(30-L) for u,f,_ in used))
print([round(u,1) for u,_,_ in sorted(used)][-15:], [round(t) for _,_,t in sorted(used)][-15:])
