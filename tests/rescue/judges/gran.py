import sys,math,collections,bisect
W=float(sys.argv[2]) if len(sys.argv)>2 else 3
P=collections.defaultdict(list);V=collections.defaultdict(list);dock={}
for l in open(sys.argv[1]):
    w=l.split()
    if not w: continue
    if w[0]=='P': P[w[1]].append(tuple(map(float,w[2:6])))
    elif w[0]=='E':
        if 'Engine(Dock)' in l and w[3]=='Heard': dock[w[1]]=float(w[2])
        if w[3]=='Log' and ' V ' in l:
            i=w.index('V');V[w[1]].append((float(w[2]),float(w[i+1])/1000,float(w[i+2])/1000,float(w[2])-dock.get(w[1],0)))
C=collections.defaultdict(list)
for k,v in V.items():
    ts=[p[0] for p in P[k]]
    rows=[]
    for t,l,n,sd in v:
        if sd<W+0.5: continue
        a=bisect.bisect_left(ts,t-W-.1);b=bisect.bisect_right(ts,t)-1
        seg=P[k][a:b+1]
        if len(seg)<3: continue
        d=math.hypot(seg[-1][1]-seg[0][1],seg[-1][2]-seg[0][2])
        hs=[s[3] for s in seg];u=[0];
        for x,y in zip(hs,hs[1:]): u.append(u[-1]+(y-x+math.pi)%(2*math.pi)-math.pi)
        r=max(u)-min(u)
        c='spin' if r>.35 and d<.1 else 'drive' if d>.15 and r<.35 else 'held' if d<.03 and r<.1 else 'other'
        C[c].append((l,n)); rows.append((t,l,n,c))
    V[k]=rows
for c,x in C.items():
    L=sorted(a for a,_ in x);N=sorted(b for _,b in x);q=lambda v,f:v[int(len(v)*f)]
    print(c,len(x),'larger p10 %.2f p50 %.2f p90 %.2f  nearer %.2f %.2f %.2f'%(q(L,.1),q(L,.5),q(L,.9),q(N,.1),q(N,.5),q(N,.9)), 'both<: %.2f'%(sum(a<-.15 and b<.05 for a,b in x)/len(x)))
# windows of K consecutive
for K in (4,6,8,12):
    R=collections.Counter();T=collections.Counter()
    for k,rows in V.items():
        for i in range(K,len(rows)+1):
            w=rows[i-K:i]
            if w[-1][0]-w[0][0]>K*.8: continue
            cs={x[3] for x in w}
            c=cs.pop() if len(cs)==1 else 'mixed'
            T[c]+=1;R[c]+=sum(x[1] for x in w)/K<-.15 and sum(x[2] for x in w)/K<.05
    print(K,{c:'%d/%d'%(R[c],T[c]) for c in T})
print('means over K=12')
for K in (8,12,16,20):
    D=collections.defaultdict(list)
    for k,rows in V.items():
        for i in range(K,len(rows)+1):
            w=rows[i-K:i]
            if w[-1][0]-w[0][0]>K*.8: continue
            cs={x[3] for x in w}
            c=cs.pop() if len(cs)==1 else 'mixed'
            D[c].append((sum(x[1] for x in w)/K,sum(x[2] for x in w)/K))
    for c,v in D.items():
        L=sorted(a for a,_ in v);N=sorted(b for _,b in v);q=lambda v,f:v[min(len(v)-1,int(len(v)*f))]
        print(K,c,len(v),'larger min %.2f p1 %.2f p5 %.2f p50 %.2f p90 %.2f p97 %.2f max %.2f | nearer p3 %.2f p50 %.2f p90 %.2f p97 %.2f'%(L[0],q(L,.01),q(L,.05),q(L,.5),q(L,.9),q(L,.97),L[-1],q(N,.03),q(N,.5),q(N,.9),q(N,.97)),
          ' '.join('%.2f:%.3f'%(t,sum(a<t and b<.05 for a,b in v)/len(v)) for t in (-.15,-.1,-.07,-.05,-.03,0)))
print('medians')
for K in (12,16,20):
    D=collections.defaultdict(list)
    for k,rows in V.items():
        for i in range(K,len(rows)+1):
            w=rows[i-K:i]
            if w[-1][0]-w[0][0]>K*.8: continue
            cs={x[3] for x in w}
            c=cs.pop() if len(cs)==1 else 'mixed'
            D[c].append(sorted(x[1] for x in w)[K//2])
    for c,v in D.items():
        L=sorted(v);q=lambda v,f:v[min(len(v)-1,int(len(v)*f))]
        print(K,c,len(v),'min %.2f p1 %.2f p5 %.2f p50 %.2f p90 %.2f p97 %.2f max %.2f'%(L[0],q(L,.01),q(L,.05),q(L,.5),q(L,.9),q(L,.97),L[-1]),' '.join('%.2f:%.3f'%(t,sum(a<t for a in v)/len(v)) for t in (-.15,-.1,-.07,-.05,-.03,0)))
